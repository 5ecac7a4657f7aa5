"""The sample run of the recording tests, as a log file."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "recording"))

import run_samples


@pytest.fixture(scope="session")
def run_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_samples.write_run(tmp_path_factory.mktemp("run"))
