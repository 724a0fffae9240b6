import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.scip.codec import OK, parse_key_values, parse_message, parse_time
from drivers.scip.commands import ScanRequest
from drivers.scip.scan import ScanDecoder
from drivers.settings.simulated_laser import LaserModel, SimulatedLaserSettings
from drivers.simulated.laser.motor import LaserMotor
from drivers.simulated.laser.payload import clustered
from drivers.simulated.laser.profiles import PROFILES, profile_of
from drivers.simulated.laser.protocol import LaserProtocol, State, Sweep
from tests.support.drivers.recorded_scip import recorded_chunks

SECOND_NS = 10**9
MODELS: tuple[LaserModel, ...] = (
    *("UTM-X001S", "UTM-30LX", "UTM-30LX-EW", "UST-10LX", "UST-20LX", "URG-04LX", "UXM-30LX-E"),
)


def laser(model: LaserModel) -> LaserProtocol:
    profile = profile_of(SimulatedLaserSettings(model=model))
    motor = LaserMotor(profile.parameters, 0.0, 1.0, 4_821_456, 0)
    codes = np.full(profile.parameters.last_step - profile.parameters.first_step + 1, 2000, np.int32)
    codes[3] = 0
    protocol = LaserProtocol(profile, motor, lambda: Sweep(42, codes))
    if protocol.legacy:
        protocol.reply(b"SCIP2.0", 0)
    return protocol


def status(protocol: LaserProtocol, command: bytes, now_ns: int = 0) -> str:
    return parse_message(protocol.reply(command, now_ns)[:-2]).status


def test_the_replies_of_the_real_sensor_are_given_byte_for_byte() -> None:
    sent = b"".join(data for _, data in recorded_chunks()).split(b"\n\n")
    protocol = laser("UTM-30LX")
    assert status(protocol, b"BM") == OK
    wanted = {raw.partition(b"\n")[0]: raw + b"\n\n" for raw in reversed(sent) if raw}
    for command in (b"VV", b"PP", b"II", b"BM", b"CR00", b"ME0000108001101"):
        assert protocol.reply(command, 0) == wanted[command]


@pytest.mark.parametrize("model", MODELS)
def test_every_model_describes_itself_in_lines_that_old_clients_can_hold(model: LaserModel) -> None:
    protocol = laser(model)
    for command, lines in ((b"VV", 5), (b"PP", 8), (b"II", 7)):
        reply = protocol.reply(command, 0)
        assert len(parse_key_values(parse_message(reply[:-2]))) == lines
        assert max(map(len, reply.split(b"\n"))) <= 70  # liburg reads lines into 72 bytes
    assert parse_key_values(parse_message(protocol.reply(b"PP", 0)[:-2]))["MODL"].startswith(model)
    assert set(PROFILES) == set(MODELS)


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        *((b"XX", "0E"), (b"VVV", "0D"), (b"TM", "0C"), (b"TM3", "01"), (b"TM1", "04"), (b"TM2", "03")),
        *((b"MD0000108101000", "04"), (b"MD0500010001000", "05"), (b"GD0000108001", "10"), (b"MD00001080", "0C")),
        *((b"SS115200", "04"), (b"CR05", "04"), (b"HS0", "0E"), (b"%ST", "0E"), (b"SCIP2.0", "0E")),
        (b"ND0000108001000", "0E"),
        *((b"VV;a*", "0H"), (b"VV;" + b"a" * 17, "0G"), (b"VV;text", "00"), (b"QT\r", "00")),
    ],
)
def test_a_command_gets_its_status(command: bytes, expected: str) -> None:
    assert status(laser("UTM-30LX"), command) == expected


def test_an_echo_repeats_the_command_with_its_string() -> None:
    assert laser("UTM-30LX").reply(b"QT;hello", 0) == b"QT;hello\n00P\n\n"


def test_the_laser_goes_on_with_bm_and_off_with_qt_and_after_a_counted_stream() -> None:
    protocol = laser("UTM-30LX")
    assert status(protocol, b"BM") == OK
    assert status(protocol, b"BM") == "02"
    assert status(protocol, b"GD0000108001") == OK
    assert status(protocol, b"MD0000108001001") == OK
    sweep = Sweep(7, np.full(1081, 2000, np.int32))
    scan = ScanDecoder(ScanRequest("MD", 0, 1080, 1, 0, 1)).decode(protocol.scan(sweep)[:-2])
    assert (scan.counter_ms, scan.remaining) == (7, 0)
    assert status(protocol, b"GD0000108001") == "10"
    assert status(protocol, b"BM") == OK
    assert status(protocol, b"QT") == OK
    assert status(protocol, b"GD0000108001") == "10"


def test_time_adjustment_refuses_everything_else_and_tells_the_clock() -> None:
    protocol = laser("UTM-30LX")
    assert [status(protocol, command) for command in (b"TM0", b"TM0", b"QT", b"BM", b"MD0000108001000")] == [
        *("00", "02", "10", "10", "10")
    ]
    reply = parse_message(protocol.reply(b"TM1", 5 * SECOND_NS)[:-2])
    assert parse_time(reply.lines[0]) == 4_821_456 + 5000
    assert status(protocol, b"TM2") == OK
    assert status(protocol, b"MD0000108001000") == OK
    assert status(protocol, b"TM0") == "10"


@pytest.mark.parametrize("command", [b"RS", b"RT"])
def test_a_reset_sets_the_clock_to_zero(command: bytes) -> None:
    protocol = laser("UTM-30LX")
    protocol.reply(command, 3 * SECOND_NS)
    values = parse_key_values(parse_message(protocol.reply(b"II", 4 * SECOND_NS)[:-2]))
    assert int(values["TIME"], 16) == 1000


def test_only_a_reboot_leaves_the_error_state_and_it_takes_two_commands_within_a_second() -> None:
    protocol = laser("UST-10LX")
    protocol.reply(b"MD0000108001000", 0)
    assert parse_message(protocol.status_in_stream("0L")[:-2]).status == "0L"
    assert status(protocol, b"QT") == "0L"
    assert parse_message(protocol.reply(b"%ST", 0)[:-2]).lines == (b"900I",)
    assert status(protocol, b"RB", 0) == "01"
    assert status(protocol, b"RB", 2 * SECOND_NS) == "01"
    assert not protocol.rebooting
    assert status(protocol, b"RB", 2 * SECOND_NS + 1) == OK
    assert protocol.rebooting


def test_a_urg_speaks_scip_1_1_until_it_is_told_to_speak_2() -> None:
    profile = profile_of(SimulatedLaserSettings(model="URG-04LX"))
    motor = LaserMotor(profile.parameters, 0.0, 1.0, 0, 0)
    protocol = LaserProtocol(profile, motor, lambda: Sweep(0, np.zeros(682, np.int32)))
    assert protocol.reply(b"QT", 0) == b"QT\nE\n\n"
    assert protocol.reply(b"V", 0).startswith(b"V\n0\nVEND:")
    assert protocol.reply(b"SCIP2.0", 0) == b"SCIP2.0\n0\n\n"
    assert protocol.reply(b"QT", 0) == b"QT\n00P\n\n"
    assert [status(protocol, command) for command in (b"SS115200", b"SS115200", b"SS000001", b"SSxxxxxx")] == [
        *("00", "03", "02", "01")
    ]
    assert [status(protocol, command) for command in (b"CR00", b"CR05", b"CR11", b"HS1", b"HS1", b"HS0")] == [
        *("03", "00", "02", "00", "02", "00")
    ]


@pytest.mark.parametrize(
    "command", [b"HD0000108001", b"HE0000108001", b"GE0000108002", b"GS0000108000", b"GD0100020003"]
)
def test_single_scans_of_every_kind_are_decoded(command: bytes) -> None:
    protocol = laser("UTM-30LX-EW")
    protocol.reply(b"BM", 0)
    first, last, cluster = int(command[2:6]), int(command[6:10]), int(command[10:12])
    scan = ScanDecoder(ScanRequest(command[:2].decode(), first, last, cluster)).decode(protocol.reply(command, 0)[:-2])
    assert scan.counter_ms == 42
    assert np.count_nonzero(scan.codes == 2000) >= len(scan.codes) - 1


@given(st.lists(st.integers(0, 3000), min_size=1, max_size=60), st.integers(1, 12))
def test_a_cluster_is_the_smallest_range_of_its_steps(codes: list[int], cluster: int) -> None:
    result = clustered(np.array(codes, np.int32), cluster, 23)
    assert len(result) == -(-len(codes) // cluster)
    for index, value in enumerate(result.tolist()):
        part = codes[index * cluster : (index + 1) * cluster]
        ranges = [code for code in part if code >= 23]
        assert value == (min(ranges) if ranges else part[0])


@given(st.binary(max_size=40), st.sampled_from(MODELS))
def test_arbitrary_commands_are_answered_with_a_status_or_not_at_all(line: bytes, model: LaserModel) -> None:
    protocol = laser(model)
    for head in (b"", b"MD", b"TM", b"SS", b"CR", b"HS", b"%"):
        command = (head + line).replace(b"\n", b"").replace(b"\r", b"")
        reply = protocol.reply(command, 0)
        assert reply == b"" or reply.startswith(command + b"\n")
        assert protocol.state in State


def test_a_sweep_that_had_begun_before_a_reset_does_not_seem_to_wrap() -> None:
    motor = LaserMotor(PROFILES["UTM-X001S"].parameters, 0.0, 1.0, 2**24 - 50, 0)
    assert motor.sweep_counter_ms(1) == 50  # this one does
    motor.reset_counter(motor.sweep_start_ns(7) + 40_000_000)
    assert [motor.sweep_counter_ms(sweep) for sweep in (7, 8)] == [0, 60]


def test_a_slower_motor_keeps_the_order_of_its_sweeps() -> None:
    parameters = PROFILES["URG-04LX"].parameters
    motor = LaserMotor(parameters, 100.0, 1.0, 0, 0)
    motor.slow_down(10, 5 * SECOND_NS)
    starts = [motor.sweep_start_ns(sweep) for sweep in range(200)]
    assert np.all(np.diff(starts) > 0)
    assert np.diff(starts)[-1] == pytest.approx(100e6 / 0.9, rel=2e-4)
    assert motor.last_complete(motor.sweep_end_ns(150)) == 150
    assert motor.last_complete(motor.sweep_end_ns(150) - 1000) == 149
    assert motor.next_start(motor.sweep_start_ns(150)) == 150
    assert motor.next_start(motor.sweep_start_ns(150) + 1000) == 151
