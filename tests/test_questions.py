"""Questions of the three kinds of users: the answer is on the page that one would open first from the index."""

import re

import pytest

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
)


def test_the_index_offers_ten_pages() -> None:
    linked = re.findall(r"\]\(([\w/]+\.md)\)", (DOCS / "index.md").read_text(encoding="utf-8"))
    assert len(linked) == len(set(linked)) == LINKS
    assert {page for _, page, *_ in QUESTIONS} <= set(linked)
    assert len(QUESTIONS) == 36


@pytest.mark.parametrize(("question", "page", "answers"), [(asked, page, words) for asked, page, *words in QUESTIONS])
def test_the_answer_is_on_the_page_that_is_opened_first(question: str, page: str, answers: list[str]) -> None:
    text = " ".join((DOCS / page).read_text(encoding="utf-8").split())
    assert [words for words in answers if words not in text] == [], question
