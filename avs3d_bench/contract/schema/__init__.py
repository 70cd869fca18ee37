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
