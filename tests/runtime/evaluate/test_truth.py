"""The truth that a run brings along may be anything."""

import io
import zipfile

import numpy as np
import pytest

from runtime.errors import NotARunError
from runtime.evaluate.truth import ATTACHMENT, LARGEST_BYTES, DataSetTruth


def packed(**arrays: object) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **{name: np.array(value) for name, value in arrays.items()})  # type: ignore[arg-type]
    return stream.getvalue()


def bomb() -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("poses.npy", bytes(LARGEST_BYTES + 1))
    return stream.getvalue()


def said(shape: tuple[int, ...], descr: str = "<f8", packing: int = zipfile.ZIP_DEFLATED, flags: int = 0) -> bytes:
    """An archive of one array whose head says more than follows."""
    head, stream = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": descr, "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(stream, "w", packing) as archive:
        archive.writestr("poses.npy", head.getvalue() + bytes(64))
    content = bytearray(stream.getvalue())
    for begin, at in ((b"PK\3\4", 6), (b"PK\1\2", 8)):
        content[content.find(begin) + at] |= flags
    return bytes(content)


ATTACHED = {
    "2**42 poses": said((1 << 40, 4)),
    "2**80 poses": said((1 << 78, 4)),
    "less than no poses": said((-1, 4)),
    "poses packed by another program": said((2, 4), packing=zipfile.ZIP_LZMA),
    "poses behind a password": said((2, 4), flags=1),
    "nothing": b"",
    "no archive": b"PK nonsense",
    "an archive that is cut off": packed(pose_kind="x", poses=np.zeros((3, 4)))[:-30],
    "an archive that unpacks to more than memory": bomb(),
    "no kind": packed(poses=np.zeros((3, 4))),
    "poses of two numbers": packed(pose_kind="x", poses=np.zeros((3, 2))),
    "poses that are text": packed(pose_kind="x", poses=[["a"] * 4]),
    "an array of its own": packed(pose_kind="x", extra=np.zeros((3, 4))),
    "objects": packed(pose_kind="x", poses=np.array([[{}] * 4], dtype=object)),
}


@pytest.mark.parametrize("name", ATTACHED)
def test_what_is_no_truth_is_refused_in_a_sentence(name: str) -> None:
    with pytest.raises(NotARunError, match=r"truth\.npz is not usable as truth"):
        DataSetTruth.from_attachments({ATTACHMENT: ATTACHED[name]})


def test_a_truth_comes_back_and_its_words_are_printable() -> None:
    truth = DataSetTruth(poses=np.ones((3, 4)), pose_kind="graph\x1b[2J", relations=np.ones((2, 5)))
    again = DataSetTruth.from_attachments({ATTACHMENT: truth.attachment()})
    assert again is not None
    assert again.pose_kind == "graph\\x1b[2J"
    assert again.poses is not None
    np.testing.assert_array_equal(again.poses, np.ones((3, 4)))
    assert DataSetTruth.from_attachments({}) is None
