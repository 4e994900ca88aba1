"""What a person sees of a sweep: a progress bar on a terminal, plain lines elsewhere."""

import sys
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress

COMPILING = "compiling the kernels: once for this version, study and processor, then kept"
LINE_SECONDS = 10.0  # between two progress lines where there is no terminal


def duration(seconds: float) -> str:
    """Return ``h:mm:ss``; under ten seconds with a decimal."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    minutes, left = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{left:02d}"


def size(count: float) -> str:
    """Return a number of bytes with a decimal unit."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"


class Screen:
    """Standard output, as a terminal or as lines."""

    def __init__(self) -> None:
        self._bar: Progress | None = None
        self._started = self._last_line = time.monotonic()

    def say(self, text: str) -> None:
        """Show one line or more, above the bar if there is one."""
        if self._bar is not None:
            self._bar.console.print(text, markup=False, highlight=False, soft_wrap=True)
        else:
            print(text, flush=True)

    def prepare(self, what: str) -> None:
        """Show that ``what`` still goes on before the first job."""
        now = time.monotonic()
        if now >= self._last_line + LINE_SECONDS:
            self._last_line = now
            self.say(f"  {what}, {duration(now - self._started)} passed")

    def start(self, total: int) -> None:
        """Begin to count ``total`` jobs."""
        self._started = self._last_line = time.monotonic()
        if not sys.stdout.isatty():
            return
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

        self._bar = Progress(
            BarColumn(bar_width=30),
            MofNCompleteColumn(),
            TextColumn("{task.fields[state]}"),
            auto_refresh=False,  # no thread beside the supervisor's loop
        )
        self._bar.add_task("jobs", total=total, state="")
        self._bar.start()

    def update(self, ended: int, failed: int, total: int, left: float | None) -> None:
        """Show the counts, and ``left`` seconds to go if that can be told."""
        now = time.monotonic()
        words = [f"{failed} failed"] if failed else []
        words.append(f"{duration(now - self._started)} passed")
        if left is not None:
            words.append(f"about {duration(left)} left")
        state = ", ".join(words)
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=ended, state=state)
            self._bar.refresh()
        elif now >= self._last_line + LINE_SECONDS:
            self._last_line = now
            self.say(f"  {ended} of {total} jobs, {state}")

    def stop(self) -> None:
        """End the bar; its last state stays."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
