"""Services without arguments: each calls a function and answers with what it returns."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rclpy.node import Node
from std_srvs.srv import Trigger

from soro_core.errors import SoroError


def create_triggers(node: Node, actions: Mapping[str, Callable[[], str]]) -> None:
    """Offer services ~/NAME of a node.

    Parameters
    ----------
    node : Node
    actions : mapping of str to callable
        Function by the name of its service; a SoroError that it raises becomes the reason of a refusal.
    """
    for name, action in actions.items():
        node.create_service(Trigger, f"~/{name}", _answering(action))


def _answering(action: Callable[[], str]) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.success, response.message = True, action()
        except SoroError as error:
            response.success, response.message = False, str(error)
        return response

    return answer
