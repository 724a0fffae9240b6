"""Settings to a decoder: a DBC, signals written in the configuration, a preset, or CiA 406 from an EDS."""

from collections import Counter

import cantools
from cantools.database.can import Message, Signal
from cantools.database.conversion import BaseConversion

from drivers.measurements import DriverError
from drivers.settings.encoders import EncoderSettings
from drivers.settings.wheel_signals import MessageSettings, WheelSignals
from drivers.wheels.layouts.direction import DirectionMessage, is_own_direction
from drivers.wheels.layouts.messages import FeedbackMessage, InfoMessage
from drivers.wheels.layouts.presets import COUNTS_PER_MOTOR_TURN
from drivers.wheels.readings import Decoder, Route, Wheel, WheelDecoder


def built_message(settings: MessageSettings) -> Message:
    """A message from the configuration; refuses signals that overlap or do not fit."""
    try:
        return Message(
            frame_id=settings.frame_id,
            name=settings.name,
            length=settings.length,
            is_extended_frame=settings.extended,
            signals=[
                Signal(
                    name=signal.name,
                    start=signal.start,
                    length=signal.length,
                    byte_order="little_endian" if signal.order == "little" else "big_endian",
                    is_signed=signal.type == "signed",
                    conversion=BaseConversion.factory(
                        scale=signal.scale, offset=signal.offset, is_float=signal.type == "float"
                    ),
                )
                for signal in settings.signals
            ],
            strict=True,
        )
    except (cantools.Error, ValueError) as error:
        raise DriverError(f"message {settings.name}: {error}; correct start and length of its signals") from error


def feedback_messages(
    messages: dict[str, Message], left: WheelSignals, right: WheelSignals, settings: EncoderSettings
) -> dict[Wheel, FeedbackMessage]:
    """The fast message of each wheel, which a driver decodes and a simulated node encodes."""
    return {
        wheel: FeedbackMessage(wheel, _named(messages, signals.message), signals, counts_per_s_of(signals, settings))
        for wheel, signals in ((Wheel.LEFT, left), (Wheel.RIGHT, right))
    }


def decoder_of(
    messages: dict[str, Message], left: WheelSignals, right: WheelSignals, settings: EncoderSettings
) -> WheelDecoder:
    """The routes from arbitration ids to both wheels' messages."""
    places = [(wheel.message, wheel.frame_id, wheel.count or wheel.speed) for wheel in (left, right)]
    if places[0] == places[1]:
        raise DriverError(f"layout: both wheels read the same signal of {left.message}; name the right wheel's own")
    if bool(left.count) != bool(right.count):
        raise DriverError("layout: one wheel has a count and the other only a speed; name the same kind for both")
    fast, routes = feedback_messages(messages, left, right, settings), dict[int, Route]()
    for wheel, signals in ((Wheel.LEFT, left), (Wheel.RIGHT, right)):
        message, feedback = _named(messages, signals.message), fast[wheel]
        shared = left.message == right.message
        _add(
            routes,
            feedback.arbitration_id,
            Route((wheel,), message.is_extended_frame, message.length, feedback.decode),
            shared,
        )
        if signals.direction and not is_own_direction(signals):
            other = _named(messages, signals.direction.rpartition(".")[0])
            gear = DirectionMessage(wheel, other, signals)
            route = Route((wheel,), other.is_extended_frame, other.length, gear.decode)
            _add(routes, gear.arbitration_id, route, wheel is Wheel.RIGHT)
        if signals.info is not None:
            slow = _named(messages, signals.info.message)
            info = InfoMessage(wheel, slow, signals.info)
            _add(
                routes,
                info.arbitration_id,
                Route((wheel,), slow.is_extended_frame, slow.length, info.decode),
                False,
            )
    chosen = {Wheel.LEFT: settings.left.modulus, Wheel.RIGHT: settings.right.modulus}
    return WheelDecoder(
        routes,
        {wheel: chosen[wheel] * abs(item.counts_per_bit) or item.modulus for wheel, item in fast.items()},
        {wheel: item.alive_modulus for wheel, item in fast.items()},
        bool(left.count),
        unsigned=tuple(wheel for wheel, item in fast.items() if not item.is_signed),
        gears=tuple(wheel for wheel, each in zip(fast, (left, right), strict=True) if _has_gear(each)),
    )


def _has_gear(signals: WheelSignals) -> bool:
    return bool(signals.direction) and not is_own_direction(signals)


def _add(routes: dict[int, Route], number: int, route: Route, shared: bool) -> None:
    """One more route; two wheels may share a message, nothing else may share an id."""
    other = routes.get(number)
    if other is None:
        routes[number] = route
        return
    if not shared:
        raise DriverError(f"layout: two messages with id 0x{number:X}; two senders of one id cannot be told apart")
    first, second = other.decode, route.decode
    both: Decoder = lambda data: first(data) + second(data)  # noqa: E731
    routes[number] = Route(other.wheels + route.wheels, route.extended, route.length, both)


def _named(messages: dict[str, Message], name: str) -> Message:
    message = messages.get(name)
    if message is None:
        raise DriverError(f"message {name}: there is only {', '.join(messages)}; correct the name in the layout")
    return message


def refuse_duplicate_ids(source: str, numbers: list[tuple[int, str]]) -> None:
    """Raise DriverError where two messages (id, name) of the source have the same id."""
    counts = Counter(number for number, _ in numbers)
    for number, count in counts.items():
        if count > 1:
            names = " and ".join(name for other, name in numbers if other == number)
            raise DriverError(
                f"{source}: id 0x{number & 0x1FFFFFFF:X} is used by {names}; give each message its own id"
            )


def counts_per_s_of(signals: WheelSignals, settings: EncoderSettings) -> float:
    """Counts per second in one unit of the speed signal."""
    has_own_scale = signals.tells_metres and signals.is_scaled_by_radius
    counts_per_metre = signals.counts_per_unit if has_own_scale else settings.counts_per_metre
    return {
        "counts_per_period": 1e9 / settings.period_ns,
        "counts_per_s": 1.0,
        "motor_turns_per_s": COUNTS_PER_MOTOR_TURN,
        "turns_per_s": settings.vehicle.counts_per_rev,
        "rpm": settings.vehicle.counts_per_rev / 60.0,
        "mps": counts_per_metre,
        "kph": counts_per_metre / 3.6,
    }[signals.speed_unit]
