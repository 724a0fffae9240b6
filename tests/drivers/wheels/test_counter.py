from hypothesis import example, given
from hypothesis import strategies as st

from drivers.settings.encoders import EncoderSettings
from drivers.wheels.counter import WheelCounter
from drivers.wheels.readings import Wheel, WheelReading
from tests.support.examples import examples

SETTINGS = EncoderSettings()
PERIOD_NS = SETTINGS.period_ns
FASTEST = 203  # counts in 20 ms at 7 km/h
LATEST = 3  # frames that another can overtake

beats = st.lists(
    st.tuples(
        st.integers(-FASTEST, FASTEST),
        st.sampled_from(["send"] * 6 + ["lose", "lose", "twice", "late1", "late2", "late3", "reset"]),
    ),
    min_size=1,
    max_size=120,
)


def wire(
    course: list[tuple[int, str]], modulus: int, start: int, with_alive: bool, with_boot: bool
) -> list[tuple[int, WheelReading, int, int, int]]:
    """Frames in the order of arrival: (stamp_ns, reading, true total, boot, beat)."""
    count, total, alive, boot, last = start, 0, 0, 0, 0
    slots: list[tuple[float, WheelReading, int, int, int]] = []
    for beat, (advance, what) in enumerate(course):
        speed_change = max(-30, min(30, advance - last))  # 14 m/s^2: more than tyres can do
        last += speed_change
        total += last
        count += last
        alive += 1
        if what == "reset":
            count, boot, alive = 0, boot + 1, 0
        reading = WheelReading(
            Wheel.LEFT,
            count % modulus,
            last / (PERIOD_NS * 1e-9),
            alive=alive % 16 if with_alive else None,
            boot_id=boot % 16 if with_boot else None,
        )
        place = beat + (float(what[-1]) + 0.5 if what.startswith("late") else 0.0)
        if what != "lose":
            slots.append((place, reading, total, boot, beat))
        if what == "twice":
            slots.append((place + 0.1, reading, total, boot, beat))
    slots.sort(key=lambda slot: slot[0])
    return [(round((place + 1) * PERIOD_NS), *rest) for place, *rest in slots]  # type: ignore[misc]


def without_resets(course: list[tuple[int, str]], most_late: int) -> list[tuple[int, str]]:
    """The same where nothing restarts, and where no more frames in a row than that come late."""
    kept, late = [], 0
    for advance, what in course:
        late = late if what == "lose" else late + 1 if what.startswith("late") and late < most_late else 0
        kept.append((advance, what if late or what in ("lose", "twice") else "send"))
    return kept


any_start = st.sampled_from([0, 100, 2**32 - 300, 2**32 - 1, 2**31])


@examples(300)
@given(course=beats, start=any_start, sign=st.sampled_from([1, -1]))
def test_any_loss_duplication_reordering_and_wrap_leaves_the_total_true(
    course: list[tuple[int, str]], start: int, sign: int
) -> None:
    course = without_resets(course, most_late=4)
    frames = wire([(0, "send"), *course, *[(0, "send")] * 8], 2**32, start, True, True)
    counter = WheelCounter(SETTINGS, sign, 2**32, 16)
    for stamp_ns, reading, total, *_ in frames:
        if counter.update(stamp_ns, reading) is None:
            assert counter.total == sign * (total - frames[0][2])
    assert counter.total == sign * (frames[-1][2] - frames[0][2])
    assert counter.epoch == 0


@examples(300)
@given(course=beats, start=any_start)
def test_a_total_is_true_until_it_is_said_to_be_broken_however_long_frames_are_late(
    course: list[tuple[int, str]], start: int
) -> None:
    """A queue that was late for a dozen frames and empties at once looks like a second sender: a new epoch begins."""
    frames = wire([(0, "send"), *without_resets(course, most_late=len(course))], 2**32, start, True, True)
    counter = WheelCounter(SETTINGS, 1, 2**32, 16)
    for stamp_ns, reading, total, *_ in frames:
        if counter.update(stamp_ns, reading) is None and counter.epoch == 0:
            assert counter.total == total - frames[0][2]


@examples(300)
@given(course=beats, start=st.sampled_from([5_000_000, 2**32 - 300]))
@example(
    course=[(0, "late1"), (0, "late3"), (0, "lose"), (0, "late2"), *[(0, "lose")] * 2, (1, "send"), (0, "reset")],
    start=5_000_000,
)
def test_any_sequence_with_resets_misses_only_motion_over_a_reset(course: list[tuple[int, str]], start: int) -> None:
    # a boot is known after a few frames; power does not come and go ten times a second
    spaced: list[tuple[int, str]] = []
    for advance, what in [(0, "send"), *course]:
        spaced += [(advance, what)] + ([(advance, "send")] * 8 if what == "reset" else [])
    frames = wire([*spaced, *[(0, "send")] * 8], 2**32, start, True, True)
    counter = WheelCounter(SETTINGS, 1, 2**32, 16)
    refused = [counter.update(stamp_ns, reading) for stamp_ns, reading, *_ in frames]
    least = most = 0
    for boot in range(frames[-1][3] + 1):
        heard = [arrival for arrival, frame in enumerate(frames) if frame[3] == boot]
        following = [arrival for arrival, frame in enumerate(frames) if frame[3] == boot + 1]
        # once two to five frames of the next boot are in, a late one of this boot comes too late
        possible = []
        for enough in range(1, 5):
            in_time = [at for at in heard if not following or at < following[enough]]
            by_age = sorted(in_time, key=lambda at: frames[at][4])
            # a queue that empties: the last frame came too soon, and the reset before another that would confirm it
            ends = by_age[-2:] if refused[by_age[-1]] == "too_soon" else by_age[-1:]
            possible += [frames[at][2] - frames[in_time[0]][2] for at in ends]
        least, most = least + min(possible), most + max(possible)
    assert least <= counter.total <= most


@examples(100)
@given(course=beats, modulus=st.sampled_from([9000, 65536, 2**24]), start=st.integers(0, 2**24))
def test_counters_without_alive_number_or_of_odd_width_unwrap_too(
    course: list[tuple[int, str]], modulus: int, start: int
) -> None:
    plain = EncoderSettings(speed_tolerance_m=0.0)
    course = [(advance, what if what in ("send", "twice", "lose") else "send") for advance, what in course]
    frames = wire([(0, "send"), *course, (0, "send")], modulus, start, False, False)
    counter = WheelCounter(plain, 1, modulus, 0)
    for stamp_ns, reading, *_ in frames:
        counter.update(stamp_ns, reading)
    if counter.epoch == 0:  # a long silence of a narrow counter is rightly called unknown
        assert counter.total == frames[-1][2] - frames[0][2]
    else:
        assert modulus == 9000


def drive(counter: WheelCounter, start_ns: int, frames: int, period_ns: int, first: int = 0, step: int = 100) -> None:
    for index in range(first, first + frames):
        reading = WheelReading(Wheel.LEFT, float(step * index), step * 50.0, alive=index % 16, boot_id=1)
        counter.update(start_ns + (index - first) * period_ns, reading)


def test_a_queue_of_two_seconds_that_arrives_at_once_is_no_loss_and_no_second_sender() -> None:
    counter = WheelCounter(SETTINGS, 1, 2**32, 16)
    drive(counter, 0, 50, PERIOD_NS)
    drive(counter, 150 * PERIOD_NS, 100, 20_000, first=50)
    drive(counter, 151 * PERIOD_NS, 50, PERIOD_NS, first=150)
    assert counter.total == 199 * 100
    assert counter.counters["lost"] == 0
    assert not counter.two_senders


def test_whole_turns_of_the_alive_number_that_were_lost_are_counted_by_time() -> None:
    counter = WheelCounter(SETTINGS, 1, 2**32, 16)
    drive(counter, 0, 50, PERIOD_NS)
    drive(counter, 90 * PERIOD_NS, 50, PERIOD_NS, first=90)
    assert counter.total == 139 * 100
    assert counter.counters["lost"] == 40


def test_a_clock_that_runs_two_percent_fast_is_not_another_sender() -> None:
    counter = WheelCounter(SETTINGS, 1, 2**32, 16)
    drive(counter, 0, 3000, round(0.98 * PERIOD_NS))
    assert counter.total == 2999 * 100
    assert set(counter.counters) == {"lost"}


def test_a_silence_in_which_a_narrow_counter_could_wrap_unseen_is_unknown_motion() -> None:
    counter = WheelCounter(EncoderSettings(speed_tolerance_m=0.0), 1, 65536, 16)
    drive(counter, 0, 10, PERIOD_NS)
    drive(counter, 300 * PERIOD_NS, 10, PERIOD_NS, first=300)
    assert counter.counters["ambiguous"] == 1
    assert counter.total == 18 * 100


def test_a_node_without_boot_id_that_starts_again_at_zero_after_a_silence_adds_nothing() -> None:
    counter = WheelCounter(EncoderSettings(speed_tolerance_m=0.0), 1, 2**32, 0)
    for index in range(50):
        counter.update(index * PERIOD_NS, WheelReading(Wheel.LEFT, 10_000.0 + 50 * index))
    for index in range(5):
        counter.update((550 + index) * PERIOD_NS, WheelReading(Wheel.LEFT, 50.0 * index))
    assert counter.counters["power_cycle"] == 1
    assert counter.total == 49 * 50 + 4 * 50
