"""What simulated nodes send, made from the description that the driver decodes with: `[encoders.layout]`."""

from dataclasses import dataclass

from drivers.measurements import DriverError
from drivers.settings.encoders import EncoderSettings
from drivers.settings.layouts import Cia406Layout
from drivers.settings.simulated_wheels import SimulatedWheelSettings, WheelFault
from drivers.settings.wheel_signals import WheelSignals
from drivers.wheels.layouts.choose import described_wheels, wheel_decoder
from drivers.wheels.layouts.direction import DirectionMessage, is_own_direction
from drivers.wheels.layouts.messages import FeedbackMessage, InfoMessage
from drivers.wheels.layouts.routes import feedback_messages
from drivers.wheels.readings import Wheel

NEEDED = {  # signals without which a fault cannot be shown
    "bad_crc": "crc",
    "status": "status",
    "alive_frozen": "alive",
    "wrong_counts_per_rev": "info",
    "jump": "count",
}


@dataclass(frozen=True, slots=True)
class SpokenLayout:
    """Messages of both wheels.

    modulus: counts after which a position starts anew, 0: never. signs: -1 for a counter that falls when the rover
    drives forward. gear: the message of another node that says which way the wheels turn. canopen: node numbers of
    CANopen encoders, which send heartbeats. shared: one frame carries both wheels.
    """

    signals: dict[Wheel, WheelSignals]
    feedback: dict[Wheel, FeedbackMessage]
    info: dict[Wheel, InfoMessage]
    modulus: dict[Wheel, float]
    signs: dict[Wheel, int]
    gear: DirectionMessage | None
    canopen: dict[Wheel, int]
    shared: bool

    def check(self, fault: WheelFault) -> None:
        """Raise DriverError for a fault that these nodes have no signal to show."""
        signal = NEEDED.get(fault.kind, "")
        if signal and not all(getattr(each, signal) for each in self.signals.values()):
            raise DriverError(
                f"wheels {fault.kind}: the layout of these wheels has no {signal} signal; choose another fault"
            )


def spoken_layout(encoders: EncoderSettings, settings: SimulatedWheelSettings) -> SpokenLayout:
    """What nodes with these settings send in the layout of the encoders. Raises DriverError with one sentence."""
    layout = encoders.layout
    own = encoders.vehicle.model_copy(
        update={
            "counts_per_rev": settings.counts_per_rev,
            "wheel_radius_left_m": settings.wheel_radius_m,
            "wheel_radius_right_m": settings.wheel_radius_m,
        }
    )
    nodes = encoders.model_copy(update={"vehicle": own, "period_ms": settings.period_ms})  # a node knows nothing else
    messages, left, right = described_wheels(layout)
    signals = {Wheel.LEFT: left, Wheel.RIGHT: right}
    if any(each.count and each.direction for each in signals.values()):
        raise DriverError("layout: a position whose sign is in another signal cannot be simulated; name the speed only")
    feedback = feedback_messages(messages, left, right, nodes)
    return SpokenLayout(
        signals,
        feedback,
        {w: InfoMessage(w, messages[each.info.message], each.info) for w, each in signals.items() if each.info},
        wheel_decoder(nodes).modulus,
        {Wheel.LEFT: encoders.left.sign, Wheel.RIGHT: encoders.right.sign},
        next((gear for each in signals.values() if (gear := _gear(messages, each)) is not None), None),
        {Wheel.LEFT: layout.left_node, Wheel.RIGHT: layout.right_node} if isinstance(layout, Cia406Layout) else {},
        feedback[Wheel.LEFT].shares_frame_with(feedback[Wheel.RIGHT]),
    )


def _gear(messages: dict, signals: WheelSignals) -> DirectionMessage | None:  # type: ignore[type-arg]  # of cantools
    if not signals.direction or is_own_direction(signals):
        return None
    return DirectionMessage(Wheel.LEFT, messages[signals.direction.rpartition(".")[0]], signals)
