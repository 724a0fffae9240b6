"""KEY=VALUE words of the command line."""

from collections.abc import Iterable

from runtime.errors import UsageError

TECHNIQUES = ("difference", "sparse", "density", "existence", "exclusivity", "range")


def key_values(words: Iterable[str]) -> dict[str, str]:
    """{"slam.particles": "200"} from "slam.particles=200". Raises UsageError on a word without "="."""
    pairs = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not key:
            raise UsageError(f"--set {word}: expected KEY=VALUE, for example --set slam.particles=200")
        pairs[key.strip()] = value.strip()
    return pairs


def without(techniques: Iterable[str]) -> dict[str, str]:
    """Overrides that switch techniques of the paper off. Raises UsageError on an unknown name."""
    pairs = {}
    for technique in techniques:
        if technique not in TECHNIQUES:
            raise UsageError(f"--without {technique}: expected one of {', '.join(TECHNIQUES)}")
        pairs[f"slam.techniques.{technique}"] = "false"
    return pairs
