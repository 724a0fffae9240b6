"""What others may do to a rover's session: say nothing for it, ask a bounded lot, and command only where rules say who.

zenoh's own limits are 1 GiB for a message and none for questions; a rover hears nothing but short questions.
"""

import json
from typing import Any

import zenoh

LARGEST_MESSAGE = 64 << 10  # bytes; a command's reason has 4 kB
MOST_SESSIONS = 64
IDENTITIES = ("cert_common_names", "usernames")  # of a subject; zids are claims
LOOPBACK = "lo"  # who is on this machine
EVERYTHING = "**"

SAYS_ITSELF = {
    "enabled": True,
    "default_permission": "allow",
    "rules": [
        {
            "id": "nobody speaks for a rover, nor through it",
            "permission": "deny",
            "flows": ["ingress"],
            "key_exprs": [EVERYTHING],
            "messages": ["put", "delete", "reply", "declare_queryable", "liveliness_token"],
        }
    ],
    "subjects": [{"id": "everyone"}],
    "policies": [{"rules": ["nobody speaks for a rover, nor through it"], "subjects": ["everyone"]}],
}
"""Access where a configuration has no rules: a peer passes on what its clients say, in the rover's name too."""


def bound(config: zenoh.Config) -> None:
    """Limit what a rover's session takes in; access rules of the configuration's own stay.

    zenoh's `downsampling` is of no use here: it drops the second of two questions that come together.
    """
    config.insert_json5("transport/link/rx/max_message_size", json.dumps(LARGEST_MESSAGE))
    config.insert_json5("transport/unicast/max_sessions", json.dumps(MOST_SESSIONS))
    if config.get_json("access_control/enabled") != "true":
        config.insert_json5("access_control", json.dumps(SAYS_ITSELF))


def command_trouble(config: zenoh.Config, rover: str) -> str:
    """Why the access rules of a configuration cannot guard the commands of a rover, "" where they can."""
    access = json.loads(config.get_json("access_control"))
    if not access["enabled"]:
        return "access_control is not enabled, so everyone may send commands"
    if access["default_permission"] != "deny":
        return "access_control.default_permission is allow, so everyone whom no rule denies it may send commands"
    commanding = {rule["id"] for rule in access["rules"] or () if _lets_command(rule, rover)}
    policies = [policy for policy in access["policies"] or () if commanding & set(policy["rules"])]
    named = {subject for policy in policies for subject in policy["subjects"]}
    subjects = [subject for subject in access["subjects"] or () if subject["id"] in named]
    if not subjects:
        return f"no rule of access_control lets anyone query infant/{rover}/command/*, so nobody may send commands"
    for subject in subjects:
        is_here = subject.get("interfaces") == [LOOPBACK]
        if not is_here and not any(any(subject.get(kind) or ()) for kind in IDENTITIES):
            return f"the subject {subject['id']!r} has neither certificate nor user name, so everyone may send commands"
    return ""


def _lets_command(rule: dict[str, Any], rover: str) -> bool:
    """Whether a rule allows questions on the keys of this rover's commands to come in."""
    from runtime.commands import Command  # loads numpy, which nobody needs who only asks how a rover is

    flows = rule["flows"] or ["ingress"]  # none named: both
    if rule["permission"] != "allow" or "query" not in rule["messages"] or "ingress" not in flows:
        return False
    keys = [zenoh.KeyExpr(f"infant/{rover}/command/{command}") for command in Command]
    return any(zenoh.KeyExpr(each).intersects(key) for each in rule["key_exprs"] for key in keys)
