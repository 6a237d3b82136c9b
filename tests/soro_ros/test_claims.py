"""Names that one program of a domain has at a time."""

from __future__ import annotations

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from soro_ros.host.claims import Claims, require_free
from tests.patience import LIMIT_S
from tests.refused import refused

pytestmark = pytest.mark.process


def in_domain(number):
    """What claims ask of a node."""
    return SimpleNamespace(context=SimpleNamespace(get_domain_id=lambda: number))


def test_a_name_is_of_one_program_until_it_is_given_back(domain):
    node, names = in_domain(domain), ["/left/controller", "/left/chambers/state"]
    with Claims() as claims:
        claims.take(node, names)
        for name in names:
            with refused(name) as caught:
                require_free(node, [name])
            assert f"process {os.getpid()} " in caught.value.got
            assert "ROS_DOMAIN_ID" in caught.value.allowed
            with refused(name), Claims() as others:
                others.take(node, ["/left/estimator", name])
        require_free(node, ["/right/controller", "/left/estimator"])
        require_free(in_domain(domain + 200), names)
    require_free(node, names)


def test_it_is_refused_however_often_it_is_asked_for(domain):
    node = in_domain(domain)
    with Claims() as claims:
        claims.take(node, ["/twin"])
        for _ in range(300):
            with refused("/twin"):
                require_free(node, ["/twin"])


TAKES = """
import sys
from types import SimpleNamespace
from soro_ros.host.claims import Claims
node = SimpleNamespace(context=SimpleNamespace(get_domain_id=lambda: int(sys.argv[1])))
Claims.take(claims := Claims(), node, ["/twin"])
print("taken", flush=True)
sys.stdin.read()
"""


def test_a_program_that_was_killed_has_no_names(domain):
    command = [sys.executable, "-c", TAKES, str(domain)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "taken\n"
        with refused("/twin") as caught:
            require_free(in_domain(domain), ["/twin"])
        assert f"process {process.pid} " in caught.value.got
    finally:
        process.kill()
        process.communicate(timeout=LIMIT_S)
    require_free(in_domain(domain), ["/twin"])


@pytest.mark.parametrize("name", ["/a" * 500, "/ä"])
def test_a_name_may_be_long(domain, name):
    with Claims() as claims:
        claims.take(in_domain(domain), [name])
        with refused(name):
            require_free(in_domain(domain), [name])
