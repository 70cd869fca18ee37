"""The solvers of `baselines.questions` as solvers of inspect_ai, in place of a model.

inspect eval evaluators/sound_questions -T folder=qa --solver baselines/listening --model none
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from inspect_ai.model import ModelOutput
from inspect_ai.solver import Generate, TaskState, solver

from avs3d_bench.contract.questions import QuestionLine
from baselines.questions import answer_one


@solver  # type: ignore[untyped-decorator]
def listening(name: str = "spatial") -> Any:
    """Answer with ears alone; no model is called.

    Args:
        name: ``spatial``, ``blind`` or ``deaf``.
    """

    async def solve(state: TaskState, generate: Generate) -> TaskState:
        line = QuestionLine.model_validate(state.metadata["line"])
        answer = answer_one(name, line, Path(state.metadata["folder"]))
        state.output = ModelOutput.from_content(model=name, content=answer)
        state.completed = True
        return state

    return solve
