from runtime.report.page import keys_marked


def test_keys_of_the_configuration_stand_out_from_the_words_of_a_remedy() -> None:
    marked = keys_marked("slam.mount.yaw_rad = 0.0314; else check the [encoders.bus] and <loop.rate_hz> twice.")
    assert "<code>slam.mount.yaw_rad = 0.0314</code>; else check the <code>[encoders.bus]</code>" in marked
    assert "&lt;<code>loop.rate_hz</code>&gt; twice." in marked


def test_a_remedy_without_keys_is_plain_words() -> None:
    sentence = "check the laser's power supply and plug. Then drive on"
    assert "<code>" not in keys_marked(sentence)
