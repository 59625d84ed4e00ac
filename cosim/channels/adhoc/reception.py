"""What arrives at one station where every frame in reach is equally strong: one is followed, two are none."""

from cosim.channels.adhoc.mac import Frame
from cosim.units import Time


class Receiver:
    """Follows a frame that begins while nothing else is there; any other that overlaps it spoils it."""

    def __init__(self) -> None:
        self.energy_from: Time = 0
        """When the first of what arrives now began to."""
        self._arriving = 0
        self._followed: Frame | None = None
        self._spoilt = False

    @property
    def energy(self) -> bool:
        """Something is arriving."""
        return self._arriving > 0

    @property
    def follows(self) -> bool:
        """A frame is being received, spoilt or not."""
        return self._followed is not None

    def begins(self, frame: Frame, deaf: bool, now: Time) -> bool:
        """Take in that *frame* begins; who is *deaf*, as it sends, follows none. Return whether all was silent."""
        if self._followed is not None:
            self._spoilt = True
        elif not self._arriving and not deaf:
            self._followed, self._spoilt = frame, False
        self._arriving += 1
        if self._arriving == 1:
            self.energy_from = now
        return self._arriving == 1

    def ends(self, frame: Frame, whole: bool) -> bool | None:
        """Take in that *frame* ends; return whether it was received, None if it was not followed."""
        self._arriving -= 1
        if frame is not self._followed:
            return None
        self._followed = None
        return whole and not self._spoilt

    def drop(self) -> None:
        """Follow no frame any more."""
        self._followed = None
