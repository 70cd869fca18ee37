"""JSON Schema (2020-12) of every JSON file of the toolkit, as written by `avs3d schema` and stored in `schemas/`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from avs3d_bench.commands.outputs import Signature, write_outputs
from avs3d_bench.contract import layout
from avs3d_bench.contract.comparisons import Comparison
from avs3d_bench.contract.frame_rows import FrameRow
from avs3d_bench.contract.questions import (
    QA_JSON,
    SCENES_JSON,
    AnswerLine,
    QaScores,
    QuestionLine,
    QuestionsRecord,
    ScenesRecord,
)
from avs3d_bench.contract.schema import (
    CameraSplits,
    DatasetRecord,
    ObservationRecord,
    PosesRecord,
    Record,
    SealRecord,
    SubmissionRecord,
)
from avs3d_bench.contract.scores import Scores, VerificationRecord
from avs3d_bench.exports.acoustics import ACOUSTICS_JSON, ResponsesRecord
from avs3d_bench.exports.release.record import RELEASE_JSON, ReleaseRecord
from avs3d_bench.exports.seld.write import SELD_JSON, SeldIndex
from avs3d_bench.exports.shards import ShardIndex

_DIALECT = "https://json-schema.org/draft/2020-12/schema"
#: File name → record.
RECORDS: dict[str, type[Record]] = {
    layout.DATASET_JSON: DatasetRecord,
    layout.OBSERVATION_JSON: ObservationRecord,
    layout.SPLITS_JSON: CameraSplits,
    layout.SUBMISSION_JSON: SubmissionRecord,
    layout.SCORES_JSON: Scores,
    layout.COMPARISON_JSON: Comparison,
    "verification.json": VerificationRecord,  # `avs3d verify --json`
    "frame_row.json": FrameRow,  # a row of the table that `avs3d-eval --frames` writes
    layout.SHARDS_JSON: ShardIndex,
    RELEASE_JSON: ReleaseRecord,
    ACOUSTICS_JSON: ResponsesRecord,  # `avs3d export acoustics`
    SELD_JSON: SeldIndex,
    layout.POSES_JSON: PosesRecord,
    layout.SEAL_JSON: SealRecord,
    QA_JSON: QuestionsRecord,
    SCENES_JSON: ScenesRecord,
    "question.json": QuestionLine,  # a line of questions.jsonl
    "answer.json": AnswerLine,  # a line of what `avs3d qa-score` reads
    "qa_scores.json": QaScores,  # `avs3d qa-score --json`
}


def json_schemas() -> dict[str, dict[str, Any]]:
    """JSON Schema of every file, by the schema's own file name (``observation.schema.json``)."""
    schemas: dict[str, dict[str, Any]] = {}
    for file_name, record in RECORDS.items():
        schema = record.model_json_schema(mode="validation")
        name = file_name.removesuffix(".json") + ".schema.json"
        schemas[name] = {"$schema": _DIALECT, "$id": name} | schema
    return schemas


def schema_texts() -> dict[str, str]:
    """File name → text of each schema file."""
    return {name: json.dumps(schema, indent=2, ensure_ascii=False) + "\n" for name, schema in json_schemas().items()}


def write_schemas(folder: Path) -> list[Path]:
    """Write the schema files into a folder, which may hold other files; returns them.

    Raises:
        UsageError: if a file of such a name is there that is no such schema.
        Avs3dError: if the system refuses.
    """
    texts = {folder / name: text.encode() for name, text in schema_texts().items()}
    own = {path.name: (Signature(values=(("$schema", _DIALECT), ("$id", path.name))),) for path in texts}
    return write_outputs(texts, own)
