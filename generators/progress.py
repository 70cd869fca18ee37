"""Shows a run: a bar with the rate and the time left, and one line per finished observation."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from generators.plan import ObservationPlan


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("– frames/s" if speed is None else f"{speed:.1f} frames/s", style="progress.data.speed")


@contextmanager
def reporting(plans: tuple[ObservationPlan, ...]) -> Iterator[Callable[[tuple[str, str, str]], None]]:
    """A listener for `generators.runner.run` that draws on stderr; lines only where stderr is not a terminal."""
    console = Console(file=sys.stderr, highlight=False)
    frames = {plan.key: plan.camera.frames for plan in plans}
    lock = threading.Lock()
    drawn: dict[str, int] = {}
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _Rate(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
    ) as bar:
        task = bar.add_task("generating", total=sum(frames.values()))

        def say(line: str) -> None:
            (bar.console if console.is_terminal else console).print(line, soft_wrap=True, markup=False)

        def listen(event: tuple[str, str, str]) -> None:
            kind, key, text = event
            with lock:
                if kind == "home":
                    bar.update(task, description=f"opening {key}")
                    say(f"home {key}: read, or built and lit where it is not in the cache yet")
                elif kind == "start":
                    bar.update(task, description="generating")
                elif kind == "frame" and drawn.get(key, 0) < frames[key]:
                    drawn[key] = drawn.get(key, 0) + 1
                    bar.advance(task)
                elif kind in ("kept", "done", "failed"):
                    bar.advance(task, frames[key] - drawn.get(key, 0))
                    drawn[key] = frames[key]
                    mark = {"kept": "kept  ", "done": "done  ", "failed": "failed"}[kind]
                    say(f"{mark} {key}" + (f"  {text}" if text else ""))

        yield listen
