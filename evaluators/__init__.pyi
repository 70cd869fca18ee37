# The public names of evaluators: type checkers read them here, and lazy_loader imports them from here on first use.
from . import metrics as metrics
from .reading.checks import check as check
from .reading.checks import check_submission as check_submission
from .reading.records import Evaluation as Evaluation
from .reading.records import InvalidSubmission as InvalidSubmission
from .reading.submission import open_submission as open_submission
from .reporting.compare import compare as compare
from .reporting.leaderboard import write_leaderboard as write_leaderboard
from .reporting.report import write_report as write_report
from .reporting.tables import write_tables as write_tables
from .score import evaluate as evaluate
from .verify import verify as verify
