"""The records behind every JSON file of the contract (pydantic v2, frozen, unknown keys refused, numbers finite).

| file                 | record              |
|----------------------|---------------------|
| `dataset.json`       | `DatasetRecord`     |
| `observation.json`   | `ObservationRecord` |
| `camera_splits.json` | `CameraSplits`      |
| `submission.json`    | `SubmissionRecord`  |
| `poses.json`         | `PosesRecord`       |
| `seal.json`          | `SealRecord`        |

Units: metres, seconds, degrees, pixels. World: right-handed, Y up; quaternions are (w, x, y, z), camera-to-world for
frames and object-to-world for instances. avs3d_bench/contract/scores.py has the record of a file of scores,
avs3d_bench/exports/schema_files.py writes the JSON Schema of each file.

Examples:
    >>> record = Dataset("data/demo")["part_1/apartment_1/bathroom/1"].record
    >>> [(instance.id, instance.category, instance.sounding) for instance in record.instances]
    [(1, 'microwave', True), (2, 'oven', False)]
    >>> frame = record.frames[0]
    >>> frame.name, frame.time, frame.line_of_sight, round(frame.distance, 2)  # seconds, metres
    ('frame_000', 0.0, True, 2.86)
    >>> schema.SubmissionRecord(method="mine", dataset="demo", dataset_version="4.0.0").model_dump(exclude_none=True)
    {'method': 'mine', 'dataset': 'demo', 'dataset_version': '4.0.0'}
"""

from avs3d_bench.contract.schema.base import (
    PART_3_VERSION,
    SCHEMA_VERSION,
    AttributionRecord,
    Category,
    FrameName,
    LicenceRecord,
    NonNegative,
    Part,
    Positive,
    ProvenanceRecord,
    Quaternion,
    Record,
    RelativePath,
    Room,
    Scalar,
    Scan,
    Sha256,
    SourceId,
    Text,
    Vector3,
    describe,
    parse_record,
    unique_attributions,
)
from avs3d_bench.contract.schema.dataset import DatasetEntry, DatasetRecord
from avs3d_bench.contract.schema.observation import (
    AUDIBLE_LEVEL_DB,
    AUDIBLE_SNR_DB,
    EARLIEST_START,
    AcousticsRecord,
    AmbisonicsRecord,
    ArrayRecord,
    AudibleRecord,
    BackgroundRecord,
    CameraSplits,
    DeviceRecord,
    DirectivityRecord,
    FrameRecord,
    HeadRecord,
    HrtfRecord,
    InstanceRecord,
    IntrinsicsRecord,
    MicrophoneRecord,
    MovedRecord,
    ObservationRecord,
    ResonanceRecord,
    SoundRecord,
    SourceRecord,
    TopViewRecord,
    VisionRecord,
)
from avs3d_bench.contract.schema.seal import (
    CommitmentsRecord,
    DrawsRecord,
    PoseRecord,
    PosesRecord,
    SealRecord,
    SecretCommitment,
)
from avs3d_bench.contract.schema.submission import SubmissionRecord

__all__ = [
    "AUDIBLE_LEVEL_DB",
    "AUDIBLE_SNR_DB",
    "EARLIEST_START",
    "PART_3_VERSION",
    "SCHEMA_VERSION",
    "AcousticsRecord",
    "AmbisonicsRecord",
    "ArrayRecord",
    "AttributionRecord",
    "AudibleRecord",
    "BackgroundRecord",
    "CameraSplits",
    "Category",
    "CommitmentsRecord",
    "DatasetEntry",
    "DatasetRecord",
    "DeviceRecord",
    "DirectivityRecord",
    "DrawsRecord",
    "FrameName",
    "FrameRecord",
    "HeadRecord",
    "HrtfRecord",
    "InstanceRecord",
    "IntrinsicsRecord",
    "LicenceRecord",
    "MicrophoneRecord",
    "MovedRecord",
    "NonNegative",
    "ObservationRecord",
    "Part",
    "PoseRecord",
    "PosesRecord",
    "Positive",
    "ProvenanceRecord",
    "Quaternion",
    "Record",
    "RelativePath",
    "ResonanceRecord",
    "Room",
    "Scalar",
    "Scan",
    "SealRecord",
    "SecretCommitment",
    "Sha256",
    "SoundRecord",
    "SourceId",
    "SourceRecord",
    "SubmissionRecord",
    "Text",
    "TopViewRecord",
    "Vector3",
    "VisionRecord",
    "describe",
    "parse_record",
    "unique_attributions",
]
