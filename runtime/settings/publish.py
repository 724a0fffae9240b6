"""Settings of what the rover tells the world over zenoh."""

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

LEAST_HZ = 0.01  # less is none, which 0 says
Endpoint = Annotated[str, Field(pattern=r"^(tcp|udp|tls|quic|ws)/\S+:\d{1,5}(#\S*)?$")]
"""For example tcp/127.0.0.1:7447 or tls/router.example:7447."""


class PublishSettings(BaseModel):
    """How the rover is reached and how much it publishes. None of this makes the loop wait."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    enabled: bool = Field(
        True,
        description="Whether anything is published; if false, no zenoh session is opened. Turn it off for a rover "
        "that drives alone",
    )
    connect: tuple[Endpoint, ...] = Field(
        ("tcp/127.0.0.1:7447",),
        description="Routers and peers to connect to, retried until they answer; 7447 is the standard port of "
        "zenoh. Add your router if other machines are to see the rover",
    )
    listen: tuple[Endpoint, ...] = Field(
        ("tcp/127.0.0.1:7448",),
        description="Addresses at which tools on this machine reach the rover without a router; the next free port "
        "if one is taken. Add an address of the network if tools on other machines are to reach it",
    )
    config_file: str | None = Field(
        None,
        min_length=1,
        description="Zenoh configuration (JSON5) to start from, for TLS and access rules; connect and listen are "
        "taken from this table. Start from config/zenoh-rover.json5",
    )
    scan_hz: float = Field(
        2.0,
        ge=0.0,
        le=50.0,
        description="Scans per second on the key scan: 0 for none, 2 are enough for viewing. Raise it for a "
        "program that works with scans, lower it on a slow link",
    )
    ros2: Literal[False, True, "humble"] = Field(
        False,
        description="Publish pose, odometry, TF, scan, landmarks, particles, path and diagnostics as a ROS 2 node "
        "under rmw_zenoh too, with gossip discovery. Turn it on if ROS 2 nodes are to see the rover: true for Jazzy "
        "and later, humble for Humble, whose keys have no hash of the type",
    )
    ros2_domain: int = Field(
        0,
        ge=0,
        le=232,
        description="ROS_DOMAIN_ID of the nodes that are to see the rover. Use the one that they run with",
    )
    commands: bool = Field(
        False,
        description="Obey commands (mark, save, stop, initial_pose) over zenoh; config_file must hold access rules "
        "that say who may send them. Turn it on if an operator is to send commands",
    )

    @field_validator("scan_hz")
    @classmethod
    def _none_or_enough(cls, hz: float) -> float:
        if 0.0 < hz < LEAST_HZ:
            raise ValueError(f"0 for no scans, or at least {LEAST_HZ:g}")
        return hz

    @model_validator(mode="after")
    def _commands_need_rules(self) -> Self:
        if self.commands and self.config_file is None:
            raise ValueError(
                "config_file to name a zenoh configuration with access_control when commands = true; "
                "config/zenoh-rover.json5 is one"
            )
        return self
