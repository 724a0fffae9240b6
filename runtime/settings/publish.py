"""Settings of what the rover tells the world over zenoh."""

from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

Endpoint = Annotated[str, Field(pattern=r"^(tcp|udp|tls|quic|ws)/\S+:\d{1,5}(#\S*)?$")]
"""For example tcp/127.0.0.1:7447 or tls/router.example:7447."""


class PublishSettings(BaseModel):
    """Where the rover is reached and how much it says. Nothing in here makes the loop wait."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    enabled: bool = Field(
        True, description="false: no session is opened and nothing is published. Off for a rover that drives alone"
    )
    connect: tuple[Endpoint, ...] = Field(
        ("tcp/127.0.0.1:7447",),
        description="routers and peers to connect to, again and again until they answer; 7447 is zenoh's own port. "
        "Name your router here where the rover shall be seen from other machines",
    )
    listen: tuple[Endpoint, ...] = Field(
        ("tcp/127.0.0.1:7448",),
        description="where tools on this machine reach the rover without a router; the next free port if it is "
        "taken. Change it to be reached from the network",
    )
    config_file: str | None = Field(
        None,
        min_length=1,
        description="zenoh configuration (JSON5) to start from, for TLS and access rules; connect, listen are set "
        "here. config/zenoh-rover.json5 is one to begin with",
    )
    scan_hz: float = Field(
        2.0,
        ge=0.0,
        le=50.0,
        description="scans per second on the key scan; 0 sends none, 2 suffice to look at. Raise it for a program "
        "that works with scans, lower it on a thin link",
    )
    ros2: bool = Field(
        False,
        description="say pose, odometry and TF as a ROS 2 node under rmw_zenoh; gossips then. On where ROS 2 nodes "
        "shall see the rover",
    )
    ros2_domain: int = Field(
        0, ge=0, le=232, description="ROS_DOMAIN_ID of the nodes that shall see them: the one that they run with"
    )
    commands: bool = Field(
        False,
        description="obey mark, save and stop over zenoh; config_file must hold access rules that say who may "
        "command. On where an operator marks from afar",
    )

    @model_validator(mode="after")
    def _commands_need_rules(self) -> Self:
        if self.commands and self.config_file is None:
            raise ValueError(
                "config_file to name a zenoh configuration with access_control where commands = true; "
                "config/zenoh-rover.json5 is one"
            )
        return self
