"""Colours and patterns of boxes: apart for colour-blind eyes, and by their lightness in grey."""

from typing import Final, NamedTuple

from cosim.export.lanes import STATE, WHOLE


class Look(NamedTuple):
    """How a box is drawn."""

    fill: str
    ink: str
    """Of the text in it."""


LOOKS: Final[dict[str, Look]] = {
    **dict.fromkeys(("ID", "ADV_IND", "SCAN_RSP", "ADV_EXT_IND"), Look("#f8d48a", "#000000")),
    **dict.fromkeys(("FHS", "SCAN_REQ", "CONNECT_IND", "CONTROL"), Look("#e69f00", "#000000")),
    "POLL": Look("#b0b0b0", "#000000"),
    **dict.fromkeys(("NULL", "EMPTY"), Look("#ebebeb", "#000000")),
    **dict.fromkeys(("DM1", "DM3", "DM5", "DATA", "frame"), Look("#0072b2", "#ffffff")),
    **dict.fromkeys(("DH1", "DH3", "DH5", "AUX1"), Look("#00436a", "#ffffff")),
    **dict.fromkeys(
        ("HV1", "HV2", "HV3", "ADV_NONCONN_IND", "AUX_ADV_IND", "AUX_CHAIN_IND"), Look("#cc79a7", "#000000")
    ),
    "RTS": Look("#4f9d7d", "#000000"),
    "CTS": Look("#93c9b1", "#000000"),
    "ACK": Look("#d9efe4", "#000000"),
    **dict.fromkeys(("RREQ", "TC"), Look("#7a3b8f", "#ffffff")),
    **dict.fromkeys(("RREP", "HELLO"), Look("#c79bd8", "#000000")),
    **dict.fromkeys(("RERR", "RREPACK", "HELLO+TC"), Look("#4a1259", "#ffffff")),
}
"""Looks of kinds of frames (colours of Okabe and Ito, and lighter and darker ones of theirs)."""
OTHER: Final = Look("#009e73", "#ffffff")
LOST_HATCH: Final = "xxxxx"
"""Pattern of a frame that was lost: what colour alone would not tell."""
_STATES: Final[dict[str, str]] = {
    **dict.fromkeys(("inquiry", "page", "scanning", "initiating"), "#fbd9a0"),
    **dict.fromkeys(("inquiry_scan", "page_scan"), "#d6e9f5"),
    **dict.fromkeys(("inquiry_response", "page_response"), "#f4b183"),
    **dict.fromkeys(("inquiry_backoff", "backoff"), "#f0eccb"),
    **dict.fromkeys(("master", "central", "link"), "#a8d5ba"),
    **dict.fromkeys(("slave", "peripheral"), "#d3ecdc"),
    "route": "#d9cbe8",
    **dict.fromkeys(("busy", "deferred"), "#cccccc"),
    "NAV": "#a9bcd8",
    **dict.fromkeys(("difs", "eifs", "awaits_ack", "awaits_cts"), "#e6e6e6"),
    **dict.fromkeys(("killed", "crashed", "frozen", "off", "jammer"), "#e9a3a0"),
}
"""Pale colours of states, alike for those of one kind: their names stand in them."""
_OTHER_STATE: Final = "#f1f1f1"
STATE_INK: Final = "#333333"


def look(kind: str) -> Look:
    """Return the look of a frame of *kind*."""
    return LOOKS.get(kind, OTHER)


def state_fill(state: str) -> str:
    """Return the pale colour of a state."""
    return _STATES.get(state, _OTHER_STATE)


def is_lost(what: str, outcome: str) -> bool:
    """Return whether a box of a lane is to be drawn as lost."""
    return what != STATE and outcome not in WHOLE
