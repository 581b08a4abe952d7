"""Fixtures of the wire tests."""

import os
from pathlib import Path

import pytest
from euroc import Euroc
from wire import Node, Wire


def pytest_report_header():
    return f"node: {os.environ.get('CAIRN_ROS')}, recordings: {os.environ.get('CAIRN_DATA')}"


@pytest.fixture(scope="session")
def euroc():
    folder = Path(os.environ["CAIRN_DATA"]) / "euroc-mh01"
    if not folder.exists():
        pytest.skip(f"skipped: {folder} is not there")
    return Euroc(folder)


@pytest.fixture
def wire():
    wire = Wire()
    yield wire
    wire.close()


@pytest.fixture
def node():
    started = []

    def start(*arguments):
        started.append(Node(*arguments))
        return started[-1]

    yield start
    for one in started:
        if one.child.poll() is None:
            one.end()
        print("\n".join(one.lines))
