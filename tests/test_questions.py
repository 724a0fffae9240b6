"""Questions of the three kinds of users: the answer is on the page that one would open first from the index."""

import re

import pytest

from runtime.report.findings.running import LATE_MS, LATE_SHARE, MISSED_ERROR_SHARE, MISSED_SHARE
from slam.quality import LOST_M, UNCERTAIN_M
from tests.support.prose import DOCS

LINKS = 10  # of the index: more are a list to search, and not a choice
QUESTIONS = (
    # the engineer who puts it on a rover
    ("Which lasers and wheels does it support?", "hardware.md", "UST-10LX, UST-20LX", "ODrive, VESC, CiA 402"),
    ("Which computer does it need, and how much disk for an hour?", "hardware.md", "1 GB of memory", "700 MB of disk"),
    ("How do I install it, and try it without a rover?", "first_hour.md", "pip install .", "run --config mock"),
    ("How do I connect an Ethernet laser, and CAN?", "first_hour.md", "192.168.0.1/24", "type can bitrate 500000"),
    ("I do not know my CAN ids. What now?", "first_hour.md", "listens on the CAN bus", "--dbc FILE"),
    (
        "From where to where do I measure the laser, and with which signs?",
        "first_hour.md",
        "ahead of base_link",
        "y left",
    ),
    ("What do I drive for a calibration?", "first_hour.md", "two loops to the left, two loops to the right"),
    (
        "How does it start with the computer, and how do I upgrade it?",
        "install.md",
        "starts after each boot",
        "git pull",
    ),
    ("The pose turns the wrong way.", "troubleshooting.md", "the two wheels are swapped"),
    ("How do I find the value of slip_m_per_sqrt_m?", "reference/configuration.md", "`infant calibrate` measures it"),
    ("At which address does it expect a UST-10LX?", "hardware.md", "tcp://192.168.0.10:10940", "infant setup --laser"),
    ("My motor controller has its own CAN frames.", "hardware.md", "SG_ COUNT", 'message = "LEFT_WHEEL"'),
    ("My laser hangs upside down, or looks backwards.", "first_hour.md", "slam.mount.upside_down = true", "3.14159"),
    (
        "What if the laser cable falls out while driving?",
        "troubleshooting.md",
        "reconnects by itself",
        "the pose follows the wheels",
    ),
    ("Does it run on Windows, or on my Ubuntu?", "hardware.md", "does not run on Windows", "Ubuntu 24.04"),
    # the reviewer of a run that somebody else drove
    ("How do I get the run from the rover?", "reading_a_review.md", "/var/lib/infant/runs", "Copy the whole folder"),
    ("The battery died. Is the run lost?", "reading_a_review.md", "up to its last complete tick", "infant log recover"),
    ("What are the red points?", "reading_a_review.md", "move between scans: mostly people"),
    ("Would other settings have helped?", "reading_a_review.md", "infant replay RUN --set"),
    ("Why did the rover say that it was lost?", "troubleshooting.md", "landmarks contradict it"),
    ("How good is it, and how does it compare with slam_toolbox?", "results.md", "slam_toolbox", "1.4 m off"),
    ("Which file of a run do I open first?", "reading_a_review.md", "open this first", "`manifest.jsonl`"),
    (
        "Which unit and frame have the columns of the CSV?",
        "reading_a_review.md",
        "metres and radians",
        "`stamp_s` is UTC",
    ),
    ("Were scans lost or late?", "reading_a_review.md", "Scans arrived late", "A superseded scan is not lost"),
    (
        "The pose jumps in the middle of the run.",
        "troubleshooting.md",
        "a wrong match was corrected",
        "infant view RUN --at",
    ),
    ("The power failed. Do I have to repair the run?", "troubleshooting.md", "needs no repair"),
    ("How much disk does an hour of recording take?", "questions.md", "700 MB", "record.budget_gb"),
    # CI and Python
    ("How do I drive it in CI, without hardware?", "journeys/ci.md", "infant run --config mock", "~/.cache/infant"),
    ("How does a test say that the pose is within 5 cm?", "journeys/ci.md", '["max_m"] > 0.05', "--out runs/changed"),
    ("Can I use it with ROS 2 Humble?", "questions.md", '`publish.ros2 = "humble"`', "Jazzy and Kilted"),
    ("Can it read a map.pgm?", "questions.md", "in a map of another program?** No", "infant map save"),
    (
        "How do I add a driver for another laser?",
        "questions.md",
        "A laser that does not speak SCIP 2",
        "architecture.md",
    ),
    (
        "How does my CI fail on a bad run?",
        "journeys/ci.md",
        "--fail-on error",
        "there is a finding of that severity or above",
    ),
    ("How do I get the poses as numpy or TUM?", "python.md", "trajectory.poses", "write_tum"),
    ("How do I inject a fault in my own test?", "python.md", 'fail("silence"', "simulated_rover"),
    ("How do I read the pose of a running rover?", "python.md", "examples/read_pose.py", "eclipse-zenoh"),
    # what a reader without any knowledge asked first
    ("Which port has my USB laser?", "hardware.md", "ls /dev/ttyACM*", 'laser.url = "serial:///dev/ttyACM0"'),
    ("Is a Raspberry Pi enough?", "hardware.md", "Raspberry Pi 4 or 5", "nobody has measured one"),
    ("Does the CAN bus come up at each boot?", "first_hour.md", "until the next boot", "`encoders.bus.bitrate`"),
    ("Do maps, configurations and runs outlive an upgrade?", "install.md", "after an upgrade", "save it again"),
    ("The rover has no internet.", "install.md", "--no-index --find-links wheels", "pip wheel --wheel-dir wheels ."),
    ("What if the CAN cable falls out while driving?", "troubleshooting.md", "wheels fall silent", "`degraded`"),
    ("Permission denied on /dev/ttyACM0.", "troubleshooting.md", "needs the group `dialout`"),
    ("How does a rover use yesterday's map?", "questions.md", "yesterday's map today?", "--map yard.map"),
    ("What do running, degraded and lost mean?", "reading_a_review.md", "*degraded* that something is missing"),
    ("How far is it from my own ground truth?", "reading_a_review.md", "--truth truth.tum", "evo calls ATE"),
    ("How do I export a run for evo or ROS?", "reading_a_review.md", "--tum FILE", "ros2 bag play"),
    ("Can I look at a run on Windows or macOS?", "reading_a_review.md", "opens in any browser", "rerun review.rrd"),
    ("How do I send a part of a run to somebody?", "reading_a_review.md", "no command cuts a part out"),
    ("What does it take in GitHub Actions?", "journeys/ci.md", "actions/cache@v4", "pip install ./infant"),
    ("How do I silence the laser in a pytest?", "journeys/ci.md", 'simulated_laser.fail("silence", duration_s=2)'),
    ("How does each CI run get the same faults?", "journeys/ci.md", 'place = "building"', "[simulation.wheels]"),
    # and second, after those had an answer
    ("Can I use a SICK or an RPLidar?", "hardware.md", "SICK, RPLidar", "no driver"),
    ("My encoders are on an Arduino.", "hardware.md", "on GPIO pins, a serial port or an Arduino"),
    ("Can I run it without root?", "install.md", "Without root there is no service"),
    ("Does it read ROS topics?", "questions.md", "scan and odometry from ROS topics?** Not while driving"),
    ("What is NEES?", "questions.md", "the covariance is too small"),
    ("What is the difference between uncertain and lost?", "reading_a_review.md", "*uncertain* (they did not"),
    ("Where are the CAN frames of a moment?", "reading_a_review.md", "`/raw/can`", "record.raw"),
    ("How do I get the landmarks?", "python.md", "`landmarks.csv`"),
    ("How do I replay many runs with many settings?", "journeys/ci.md", "infant sweep runs/yard runs/gate"),
    ("How do I simulate my own rover in CI?", "journeys/ci.md", "simulates your own rover", "infant_configuration"),
    ("My laser sees the mast of the rover.", "hardware.md", "`slam.front_end.range_min_m` above the distance"),
    ("How high and how level must the laser be?", "hardware.md", "mount the laser level", "posts, trunks and corners"),
    ("How fast may it drive?", "hardware.md", "`vehicle.max_speed_mps`", "1.9 m/s"),
    ("Must it stand still when a run starts?", "first_hour.md", "Start a run while the rover stands"),
    ("When do I have to calibrate again?", "first_hour.md", "changed a tyre, its pressure, the load"),
    ("One of my motors counts backwards.", "first_hour.md", "which counts fall when the rover drives forward"),
    ("Which ports must my firewall open?", "install.md", "no port needs to be opened", "port 7448"),
    (
        "At what time of day did it happen?",
        "reading_a_review.md",
        "seconds since the first tick; add them to the start",
    ),
    ("Which of these runs is yesterday's drive?", "reading_a_review.md", "names sort by time"),
    ("Which version recorded it?", "reading_a_review.md", "`infant log info RUN` shows when and with which version"),
    ("How do I send somebody a picture of it?", "reading_a_review.md", "--screenshot FILE.png"),
    ("What is a pose that claims too little?", "reading_a_review.md", "the pose trusts itself too much"),
    (
        "How does each CI run get another world?",
        "journeys/ci.md",
        "`--seed N` chooses another filter and another world",
    ),
    ("Can two jobs drive on one computer at once?", "journeys/ci.md", "devices and publisher take free ports"),
    ("Does it work in rain, or behind glass?", "hardware.md", "Rain, fog, dust and low sun were not tried"),
    ("How do I keep it from starting at boot?", "install.md", "`sudo systemctl disable infant`"),
    ("Does installing it need a compiler?", "journeys/ci.md", "Installing needs no compiler"),
    ("Can the simulated rover drive my route?", "journeys/ci.md", "drives a fixed course"),
    ("How do I put it into a container image?", "journeys/ci.md", "`RUN infant warmup` after the installation"),
    # and third, of which these had no answer where it was sought
    ("Can I install it with pip alone?", "questions.md", "Is it on PyPI?** No"),
    ("Does it stop the rover when it is lost?", "questions.md", "your program has to stop the rover"),
    ("What happens when the disk of the rover is full?", "install.md", "the oldest minutes of the run are removed"),
    ("Is the link to the rover encrypted?", "install.md", "Such a link is not encrypted"),
    ("Do two rovers on one network disturb each other?", "questions.md", "They do not hear each other"),
    (
        "Which topics and frames does ROS 2 get?",
        "questions.md",
        "`/<rover>/pose`",
        "`map` > `odom` > `base_link` > `laser`",
    ),
    ("Which clock do the stamps have?", "questions.md", "has the UTC of the rover's computer"),
    ("How often must the wheels send?", "hardware.md", "`encoders.period_ms`", "at most 1000"),
    ("Why does my run have so few landmarks?", "troubleshooting.md", "among walls few landmarks are normal"),
    ("How large may the place be?", "questions.md", "25 000 landmarks"),
    ("How much of the processor does it take?", "hardware.md", "of the 100 ms that it has"),
    ("Does it give latitude and longitude?", "questions.md", "--origin LAT,LON,HEADING"),
    ("How do I know that a run was good?", "reading_a_review.md", "*healthy* (a good run)"),
    # and fourth, of which these had no answer, or half of one, where it was sought
    ("Can I install it on Debian 13, or on ARM?", "install.md", "for Debian 13 or Ubuntu 24.04, on x86-64 or aarch64"),
    ("How many counts is a metre?", "hardware.md", "no key for counts per metre", "`counts_per_rev`"),
    ("From which sigma on is the pose bad?", "reading_a_review.md", f"above {UNCERTAIN_M:g} m", f"above {LOST_M:g} m"),
    ("How do I get path and map into another program?", "questions.md", "(`--csv`, `--tum`", "infant map draw RUN"),
    ("Does another machine replay the same bits?", "journeys/ci.md", "never does, on any x86-64"),
    ("How do I start and stop a run from Python?", "python.md", 'subprocess.Popen(["infant", "run"', "SIGTERM ends it"),
    # and fifth, of which these had no answer, or half of one, where it was sought
    (
        "Who brings up can1 at boot?",
        "install.md",
        "`sudo systemctl enable --now systemd-networkd`",
        "prints the command",
    ),
    ("Which groups does the user of the service need?", "install.md", "in the group `dialout`", "CAN needs no group"),
    ("How do I go back, and keep my maps?", "install.md", "`sudo git checkout COMMIT`", "stay where they are"),
    ("NTP moves the clock during a drive.", "troubleshooting.md", "a clock that nobody sets", "restart infant"),
    ("When was it degraded, and why?", "reading_a_review.md", "was in each state, when, and why"),
    (
        "How many late beats are bad?",
        "reading_a_review.md",
        f"{LATE_SHARE:.0%} of the beats begin more than {LATE_MS:.0f} ms late".replace("%", " %"),
        f"if {MISSED_SHARE * 100:g} % are missed, and an *error* from {MISSED_ERROR_SHARE * 100:g} %",
    ),
    ("What does a review say of a rover that was lifted?", "reading_a_review.md", "lifted, carried or pushed"),
    ("Does CI need root, vcan, a display or a network?", "journeys/ci.md", "It needs no root, no CAN in the kernel"),
    ("Can it simulate faster than real time?", "journeys/ci.md", "up to ten times as fast", "infant soak"),
    ("Does the call for the pose block, and where is yaw?", "python.md", "Only `poses.get` waits", "pitch, yaw"),
    ("Does its tf collide with robot_localization?", "questions.md", "frames begin with the rover's name"),
    ("Can I import my own CSV of a SICK?", "questions.md", "Can it import my own CSV", "data_sets.md#your-own-csv"),
)


def test_the_index_offers_ten_pages() -> None:
    linked = re.findall(r"\]\(([\w/]+\.md)\)", (DOCS / "index.md").read_text(encoding="utf-8"))
    assert len(linked) == len(set(linked)) == LINKS
    assert {page for _, page, *_ in QUESTIONS} <= set(linked)
    assert len(QUESTIONS) == 112


@pytest.mark.parametrize(("question", "page", "answers"), [(asked, page, words) for asked, page, *words in QUESTIONS])
def test_the_answer_is_on_the_page_that_is_opened_first(question: str, page: str, answers: list[str]) -> None:
    text = " ".join((DOCS / page).read_text(encoding="utf-8").split())
    assert [words for words in answers if words not in text] == [], question
