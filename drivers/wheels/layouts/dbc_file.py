"""Of a DBC file, what the wheels need: the messages that the layout names, whatever else stands in the file.

Real files have comments in the encoding of whoever wrote them, signals that overlap in messages of other nodes, and
lines of tools that no parser knows. Only the named messages are judged, and handed to cantools as a file of their own.
"""

import os
import re
from collections import Counter
from collections.abc import Collection, Iterable
from pathlib import Path

from cantools.database.can import Database, Message

from drivers.measurements import DriverError

LARGEST_BYTES = 1 << 23  # 8 MB; the DBC of a whole lorry has 5
MOST_MESSAGES = 20_000  # a whole lorry has some thousand
MOST_NAMED = 12
ENCODINGS = ("utf-8-sig", "cp932", "cp1252", "latin-1")  # names are ASCII; whichever fits shows a unit as it was meant
UTF16 = (b"\xff\xfe", b"\xfe\xff")
# without backtracking, which takes 80 bytes for each of a comment that does not end
COMMENT = re.compile(r'^[ \t]*CM_\s[^"\n]*"(?:[^"\\]|\\.)*+"\s*;', re.MULTILINE)
BO_LINE = re.compile(r"^\s*BO_\s+(\d{1,10})\s+(\w+)\s*:\s*(\d{1,9})\b")
SG_LINE = re.compile(
    r"^\s*SG_\s+([A-Za-z_]\w*)\s*(M|m\d+M?)?\s*:\s*(\d{1,4})\s*\|\s*(\d{1,4})\s*@\s*([01])\s*([+-])"
    r"\s*\(\s*([^,()]+?)\s*,\s*([^,()]+?)\s*\)\s*(?:\[\s*([^|\]]*?)\s*\|\s*([^|\]]*?)\s*\])?"
)
LONG_NAME = re.compile(
    r'^\s*BA_\s+"System(Message|Signal)LongSymbol"\s+(?:BO_|SG_)\s+(\d{1,10})\s+(?:(\w+)\s+)?"(\w+)"'
)
STANDARD_ID, EXTENDED_BIT = 0x7FF, 1 << 31
LONGEST_MESSAGE = 64  # bytes of a CAN FD frame; cantools makes a number of as many bits as a message says it has
LONGEST_NUMBER = 10  # digits of an id
MOST_LINES = 1000  # of one message, its multiplexed signals included; cantools compares each with each
MOST_VALUES = 1 << 16  # of multiplexers, for all signals of a message; cantools lists each of them
VALUES = re.compile(r"(\d+)\s*-\s*(\d+)")
KEPT = ("SIG_VALTYPE_", "SG_MUL_VAL_")
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d{1,3})?")


def dbc_messages(path: Path, names: Iterable[str], signals: Collection[str] = ()) -> dict[str, Message]:
    """The messages of these names. Raises DriverError with one sentence: for what is missing, twice there or wrong.

    signals: those that the wheels read; where a message is sound in these, it may have others that overlap.
    """
    wanted = dict.fromkeys(names)
    blocks = _blocks(path, dbc_text(path))
    by_name = Counter(block.name for block in blocks)
    by_id = Counter(block.number for block in blocks)
    chosen = [block for block in blocks if block.name in wanted]
    for block in chosen:
        if by_name[block.name] > 1:
            raise DriverError(f"{path}: message {block.name} is defined {by_name[block.name]} times; keep one of them")
        if block.length > LONGEST_MESSAGE:
            raise DriverError(
                f"{path}: message {block.name} has {block.length} bytes, a frame has at most {LONGEST_MESSAGE}; "
                "correct its length"
            )
        block.refuse_endless(path)
        if by_id[block.number] > 1:
            others = " and ".join(other.name for other in blocks if other.number == block.number)
            raise DriverError(
                f"{path}: id 0x{block.number & 0x1FFFFFFF:X} is used by {others}; give each message its own id"
            )
    if missing := [name for name in wanted if not by_name[name]]:
        known = ", ".join(list(by_name)[:MOST_NAMED]) or "no message at all"
        more = f" and {len(by_name) - MOST_NAMED} more" if len(by_name) > MOST_NAMED else ""
        raise DriverError(f"{path}: message {missing[0]}: there is only {known}{more}; correct the name in the layout")
    failure: Exception | None = None
    for reduced in (False, True):
        for block in chosen if reduced else ():
            block.keep(signals)
        try:
            return _read(chosen)
        except Exception as error:  # noqa: BLE001 cantools' parser has a family of its own
            failure = failure or error  # the one with all signals tells more
    reason = " ".join(str(failure).split())[:200]
    raise DriverError(f"{path}: not a usable DBC ({reason}); correct the file or name another") from failure


def _count(low: str, high: str) -> int:
    """Values from one to the other; one too many where they have more digits than any multiplexer."""
    return MOST_VALUES + 1 if len(low + high) > 2 * LONGEST_NUMBER else max(0, int(high) - int(low) + 1)


def _read(blocks: "list[_Block]") -> dict[str, Message]:
    """Messages as cantools makes them. Raises whatever it and its parser raise."""
    database = Database(strict=True)
    text = ['VERSION ""', "NS_ :", "BS_:", "BU_: X", *(block.text() for block in blocks)]
    database.add_dbc_string("\n\n".join(text) + "\n")
    return {message.name: message for message in database.messages}


class _Block:
    """One message with its signals, as cantools reads them: without units, receivers and whatever follows."""

    def __init__(self, number: int, name: str, length: int) -> None:
        is_extended = STANDARD_ID < number < EXTENDED_BIT  # some tools leave the bit out that says so
        self.number, self.name, self.length = number | EXTENDED_BIT * is_extended, name, length
        self.signals: dict[str, str] = {}
        self.further: list[str] = []

    def refuse_endless(self, path: Path) -> None:
        """Raises DriverError where cantools would read for minutes, or fill the memory."""
        ranges = [found for line in self.further if line.startswith(KEPT[1]) for found in VALUES.findall(line)]
        values = sum(_count(low, high) for low, high in ranges)
        lines = len(self.signals) + len(self.further)
        for count, most, what in ((lines, MOST_LINES, "lines"), (values, MOST_VALUES, "values of multiplexers")):
            if count > most:
                raise DriverError(
                    f"{path}: message {self.name} has {count} {what}, of which {most} are allowed; correct it or leave "
                    "out what no wheel sends"
                )

    def keep(self, signals: Collection[str]) -> None:
        """Leave out what nobody reads: all but these and the multiplexers, where these are given and there."""
        kept = {name: rest for name, rest in self.signals.items() if name in signals}
        if kept:
            self.signals = {name: rest for name, rest in self.signals.items() if name in kept or rest[:1] in "Mm"}
            self.further = [line for line in self.further if any(name in line.split() for name in self.signals)]

    def text(self) -> str:
        """The message as lines of a DBC."""
        lines = [f" SG_ {name} {rest}" for name, rest in self.signals.items()]
        return "\n".join([f"BO_ {self.number} {self.name}: {self.length} X", *lines, "", *self.further])


def dbc_text(path: Path) -> str:
    """The file without its comments, in whatever encoding it was saved. Raises DriverError."""
    try:
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as stream:  # a pipe would not end
            raw = stream.read(LARGEST_BYTES + 1) or b""
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise DriverError(f"{path}: cannot be read ({reason}); give the path of a DBC") from error
    if len(raw) > LARGEST_BYTES:
        raise DriverError(f"{path}: has more than {LARGEST_BYTES >> 20} MB; give the path of a DBC")
    text = decoded(raw)
    if "BO_" not in text:
        raise DriverError(f"{path}: holds no message (BO_), so it is not a DBC; give the path of a DBC")
    return COMMENT.sub("", text)


def decoded(raw: bytes) -> str:
    """The text of a file of others, in the first encoding that fits."""
    for encoding in ("utf-16", *ENCODINGS) if raw.startswith(UTF16) else ENCODINGS:
        try:
            return raw.decode(encoding)
        except UnicodeDecodeError:
            continue
    return raw.decode("latin-1")  # fits always


def _blocks(path: Path, text: str) -> list[_Block]:
    """All messages; signals whose line cannot be read are left out, and missed where the layout names them."""
    blocks: list[_Block] = []
    by_number: dict[int, _Block] = {}
    long_names: list[tuple[int, str | None, str]] = []
    current: _Block | None = None
    for line in text.splitlines():
        if found := BO_LINE.match(line):
            current = _Block(int(found[1]), found[2], int(found[3]))
            blocks.append(current)
            if len(blocks) > MOST_MESSAGES:
                raise DriverError(
                    f"{path}: has more than {MOST_MESSAGES} messages; leave out those that no wheel sends"
                )
            by_number.setdefault(int(found[1]), current)
        elif line.lstrip().startswith("SG_ "):
            if current is not None and (signal := _signal(line)) is not None:
                current.signals.setdefault(*signal)
        elif line.strip():
            current = None
            words = line.split(maxsplit=2)
            has_id = len(words) > 2 and words[1].isdecimal() and len(words[1]) <= LONGEST_NUMBER
            if words[0] in KEPT and has_id and int(words[1]) in by_number:
                by_number[int(words[1])].further.append(line.strip())
            elif found := LONG_NAME.match(line):
                long_names.append((int(found[2]), found[3], found[4]))
    for number, short, long in long_names:
        _lengthen(by_number.get(number), short, long)
    return blocks


def _signal(line: str) -> tuple[str, str] | None:
    """(name, the rest of a line) as cantools reads it; None where the line is none."""
    found = SG_LINE.match(line)
    if found is None:
        return None
    name, multiplexer, start, length, order, sign, scale, offset, low, high = found.groups()
    if not (NUMBER.fullmatch(scale) and NUMBER.fullmatch(offset)):
        return None
    limits = "|".join(repr(float(each)) if each and NUMBER.fullmatch(each) else "0" for each in (low, high))
    scaled = f"({float(scale)!r},{float(offset)!r})"  # cantools reads no .25
    return name, f'{multiplexer or ""} : {start}|{length}@{order}{sign} {scaled} [{limits}] "" X'


def _lengthen(block: _Block | None, signal: str | None, name: str) -> None:
    """Give a message or a signal the long name that an attribute holds, its own being cut to 32 characters."""
    if block is None:
        return
    if signal is None:
        block.name = name
    elif signal in block.signals and name not in block.signals:
        block.signals = {name if each == signal else each: rest for each, rest in block.signals.items()}
        block.further = [re.sub(rf"\b{signal}\b", name, line) for line in block.further]
