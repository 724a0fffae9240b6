"""[encoders.bus]: which CAN interface, at which bit rate, and when it counts as silent."""

from pydantic import BaseModel, ConfigDict, Field


class BusSettings(BaseModel):
    """One CAN bus, in the terms of python-can. Any interface of python-can can be used."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    interface: str = Field(
        default="udp_multicast",
        pattern=r"^[a-z0-9_]+$",
        description="Interface of python-can: socketcan, slcan, pcan, kvaser, gs_usb, virtual, udp_multicast, ... "
        "Name the adapter that is plugged in; udp_multicast is for a simulated rover",
    )
    channel: str = Field(
        default="239.74.163.2",
        min_length=1,
        description="Name of the bus on that interface: can0, a serial device, or a multicast group. `ip link` "
        "lists SocketCAN interfaces; the default is python-can's own IPv4 group",
    )
    bitrate: int = Field(
        default=500_000,
        ge=10_000,
        le=1_000_000,
        description="Bit rate, passed to adapters that accept one and quoted in advice otherwise. Take the one "
        "that the encoders are set to; a wrong one shows as error frames",
    )
    port: int = Field(
        default=0,
        ge=0,
        le=65_535,
        description="UDP port of udp_multicast; 0 lets the simulated node choose a free one. Set it if another "
        "program is to listen too",
    )
    options: dict[str, bool | int | float | str] = Field(
        default_factory=dict,
        description="Further keyword arguments of that python-can interface. Set them for an adapter that needs "
        "more; the documentation of python-can lists them",
    )
    receive_buffer_bytes: int = Field(
        default=8_388_608,
        ge=4096,
        le=67_108_864,
        description="Size of the receive buffer requested from the kernel: one second of 20 000 frames. Raise it "
        "if the review reports frames lost because the buffer was full",
    )
