"""One small finished run, written once for all tests of this folder."""

from pathlib import Path

import pytest
import run_samples

from sandwich_sitl.recording.reader import RunLog


@pytest.fixture(scope="session")
def run_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_samples.write_run(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="session")
def run_log(run_path: Path) -> RunLog:
    return RunLog.read(run_path)
