"""When was a scan measured, by a clock that is not ours, over a link that changes? Begin at drift.py."""
