"""[encoders.bus]: which CAN interface, at which bit rate, and when it counts as silent."""

from pydantic import BaseModel, ConfigDict, Field


class BusSettings(BaseModel):
    """One CAN bus as python-can knows it; any interface that python-can has can be named."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    interface: str = Field(
        default="udp_multicast",
        pattern=r"^[a-z0-9_]+$",
        description="python-can interface: socketcan, slcan, pcan, kvaser, gs_usb, virtual, udp_multicast, ... "
        "Which adapter is plugged in; udp_multicast is for a simulated rover",
    )
    channel: str = Field(
        default="239.74.163.2",
        min_length=1,
        description="can0, a serial device, or the multicast group: what the adapter is called there. The default "
        "is python-can's own IPv4 group",
    )
    bitrate: int = Field(
        default=500_000,
        ge=10_000,
        le=1_000_000,
        description="bit/s; given to adapters that take it, named in advice otherwise. The one that the encoders "
        "are set to; a wrong one shows as error frames",
    )
    port: int = Field(
        default=0,
        ge=0,
        le=65_535,
        description="UDP port of udp_multicast; 0: the simulated node picks one that is free. Set it where another "
        "program shall listen too",
    )
    options: dict[str, bool | int | float | str] = Field(
        default_factory=dict,
        description="further keyword arguments of that python-can interface. For adapters that need more; "
        "python-can's pages name them",
    )
    receive_buffer_bytes: int = Field(
        default=8_388_608,
        ge=4096,
        le=67_108_864,
        description="asked of the kernel, bytes: a second of 20 000 frames. Raise it where the report tells of "
        "frames that were lost because the buffer was full",
    )
