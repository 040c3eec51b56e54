"""Studies: questions about a robot that need thousands of computations. They run on any
`concurrent.futures.Executor`.

A study is a question, a space of parameters, a seed and a metric. Its tasks are numbered and independent, so
the results do not depend on the number of workers or their order. Finished chunks of tasks are files in a
folder. So a run that was killed continues where it ended.

    from cobot.studies import load_study, run_study

    result = run_study(load_study("reach.yaml"), "reach-result")
    print(result.answer)
"""

from __future__ import annotations

from cobot.studies.chunks import Columns
from cobot.studies.engines.local_pool import LocalPool, LostWorkerError
from cobot.studies.orders import ForeignWorkerError
from cobot.studies.results.folder import ResultsFolder
from cobot.studies.running import Advance, StudyResult, run_study
from cobot.studies.study import Study
from cobot.studies.study_file import load_study, study_of

__all__ = [
    "Advance",
    "Columns",
    "ForeignWorkerError",
    "LocalPool",
    "LostWorkerError",
    "ResultsFolder",
    "Study",
    "StudyResult",
    "load_study",
    "run_study",
    "study_of",
]
