"""Who may look at the view and who may press: each request by itself, without a server."""

import re
from http import HTTPStatus

import pytest

from soro_ros.view.access import Access

PORT = 8080
OWN = {"Host": "127.0.0.1:8080"}
SOCKET = {**OWN, "Upgrade": "websocket", "Origin": "http://127.0.0.1:8080"}


@pytest.fixture
def access():
    return Access("the-token")


def test_a_token_is_random_and_stands_in_the_address():
    tokens = {
        re.search(r"^http://127\.0\.0\.1:8080/\?token=([\w-]{32})$", Access().address(PORT))[1] for _ in "ab"
    }
    assert len(tokens) == 2


def test_the_page_and_its_own_web_socket_are_answered(access):
    assert access.answer("/", OWN, PORT) is None
    assert access.answer("/", SOCKET, PORT) is None
    assert access.answer("/", {"Host": "localhost:8080"}, PORT) is None


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "attacker.example:8080"},  # a name that was bound anew to this host
        {"Host": "127.0.0.1"},
        {},
        {**SOCKET, "Origin": "http://attacker.example"},
        {**SOCKET, "Origin": "http://127.0.0.1:3000"},  # the same site, as cookies see it
        {**SOCKET, "Origin": "http://localhost:8080"},
        {**SOCKET, "Origin": "null"},
        {**OWN, "Upgrade": "websocket"},  # no browser
        {**OWN, "Origin": "http://attacker.example"},
    ],
)
def test_other_pages_and_other_names_are_refused(access, headers):
    assert access.answer("/", headers, PORT).status is HTTPStatus.FORBIDDEN


def test_the_token_becomes_a_cookie_of_this_page_alone(access):
    answer = access.answer("/?token=the-token", OWN, PORT)
    assert (answer.status, answer.headers["Location"]) == (HTTPStatus.SEE_OTHER, "/")
    cookie, *attributes = answer.headers["Set-Cookie"].split("; ")
    assert {"HttpOnly", "SameSite=Strict"} <= set(attributes)
    assert access.may_press({"Cookie": f"other=1; {cookie}"}, PORT)
    assert not access.may_press({"Cookie": cookie}, PORT + 1)


@pytest.mark.parametrize("token", ["", "the-toke", "the-token-", "THE-TOKEN", "%00", "t\u00f6ken"])
def test_a_wrong_token_gives_nothing(access, token):
    answer = access.answer(f"/?token={token}&x=1", OWN, PORT)
    assert answer is None or (answer.status is HTTPStatus.FORBIDDEN and "Set-Cookie" not in answer.headers)
    assert not access.may_press({"Cookie": f"soro_view_{PORT}={token}"}, PORT)
    assert not access.may_press({}, PORT)
