"""A film of a run: one picture after the other, as .mp4, or as an animated .webp or .gif."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from cosim.errors import UserError
from cosim.export.lanes import STATES, Lane, lanes
from cosim.export.recording import Recording
from cosim.picture.moment import Room, View, draw_moment, room_for
from cosim.picture.window import Box, boxes
from cosim.trace import drafted
from cosim.units import MS, S, Time

A_SECOND: Final = 25
"""Pictures a second of a film."""
A_SECOND_OF_WEB: Final = 10
"""The same of a .webp or .gif, which a page loads whole."""
DPI: Final = 130
DPI_OF_WEB: Final = 100
BEHIND: Final = 15 * MS
"""The least time before its moment that a picture shows, and after it: as fast a film, as long a time."""
MOST_PICTURES: Final = 20_000
"""The most pictures of a film: what takes longer than an hour to draw was not meant."""


def encoder() -> str:
    """Return the program that encodes an .mp4; raise UserError, with the way to get one, if there is none."""
    found = shutil.which("ffmpeg")
    if found is None and find_spec("imageio_ffmpeg") is not None:
        import imageio_ffmpeg

        try:
            found = imageio_ffmpeg.get_ffmpeg_exe()
        except RuntimeError:  # its package brings none for this computer
            found = None
    if found is None:
        raise UserError("an .mp4 needs an encoder: install ffmpeg, or pip install imageio-ffmpeg; .webp does without")
    return found


def write_film(
    recording: Recording,
    path: Path,
    span: tuple[Time, Time],
    speed: float,
    told: Callable[[int, int], Any] = lambda done, total: None,
) -> int:
    """Write a film of *recording* in the *span* of time to *path*, and return how many pictures it has.

    *speed* is how many simulated seconds pass in a second of it; *told* is given how many are drawn, and of how many.
    Raise UserError if it would be too long, or if there is no encoder.
    """
    rate = A_SECOND if path.suffix == ".mp4" else A_SECOND_OF_WEB
    step = max(1, round(speed * S / rate))
    moments = range(span[0], span[1], step)
    if len(moments) > MOST_PICTURES:
        raise UserError(f"--speed: {len(moments)} pictures at {speed:g}, a film has {MOST_PICTURES} at most")
    pictures = _pictures(recording, moments, DPI if path.suffix == ".mp4" else DPI_OF_WEB, told)
    path.parent.mkdir(parents=True, exist_ok=True)
    with drafted(path) as draft:
        if path.suffix == ".mp4":
            _encode(pictures, draft, rate)
        else:
            first = next(pictures)
            more = {"quality": 60, "method": 4, "minimize_size": True} if path.suffix == ".webp" else {"optimize": True}
            first.save(
                draft, path.suffix[1:], save_all=True, append_images=pictures, duration=1000 // rate, loop=0, **more
            )
    return len(moments)


def _pictures(recording: Recording, moments: range, dpi: int, told: Callable[[int, int], Any]) -> Iterator[Image.Image]:
    """Yield the pictures of *moments*, all of one size."""
    found = lanes(recording)
    reach = max(BEHIND, 2 * moments.step)
    room = _room(recording, found, (moments.start - reach, moments.stop + reach))
    size: tuple[int, int] | None = None
    for number, at in enumerate(moments, start=1):
        figure, _ = draw_moment(recording, View(at, at - reach, at + reach, room=room), found)
        canvas: Any = FigureCanvasAgg(figure)
        figure.set_dpi(dpi)
        canvas.draw()
        picture = Image.frombuffer("RGBA", canvas.get_width_height(), canvas.buffer_rgba()).convert("RGB")
        size = size or (picture.width // 2 * 2, picture.height // 2 * 2)
        yield picture if picture.size == size else picture.crop((0, 0, *size))
        told(number, len(moments))


def _room(recording: Recording, found: Sequence[Lane], span: tuple[Time, Time]) -> Room:
    """Return room for all states in the *span* of time, and for a frame of each kind and outcome on each lane."""
    frames = [
        Box(0, 0, lane.robot, lane.radio, lane.what, kind, -1, outcome, -1, "", "")
        for lane in found
        if lane.what not in STATES
        for kind, outcome in dict.fromkeys(zip(lane.kinds, lane.outcomes, strict=True))
    ]
    return room_for([*frames, *boxes(recording, (lane for lane in found if lane.what in STATES), *span)])


def _encode(pictures: Iterator[Image.Image], path: Path, rate: int) -> None:
    """Hand *pictures* to the encoder, which writes *path*; raise UserError with its last words if it fails."""
    program = encoder()
    first = next(pictures)
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{first.width}x{first.height}", "-r", str(rate), "-i", "-"]
    result = ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart", "-f", "mp4", str(path)]
    with tempfile.TemporaryFile() as words:
        command = [program, "-y", "-loglevel", "error", *source, *result]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=words) as process:
            assert process.stdin is not None
            try:
                process.stdin.write(first.tobytes())
                for picture in pictures:
                    process.stdin.write(picture.tobytes())
                process.stdin.close()
            except BrokenPipeError:  # its last words say why
                pass
            failed = process.wait() != 0
        if failed:
            words.seek(0, os.SEEK_SET)
            last = words.read().decode(errors="replace").strip().splitlines()[-1:] or ["no word of why"]
            raise UserError(f"{program}: {last[0]}")
