"""Messages between the nodes of one process, which need not pass the middleware."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy
from rclpy.serialization import serialize_message
from rclpy.subscription import Subscription

if TYPE_CHECKING:
    from rclpy.executors import Executor

# Readers that one task serves, and then the executor: in lockstep each command brings the next readings.
TURNS = 100
# Information of a message that is handed over: it has no number, and comes from the only publisher.
HANDED_OVER = {"publication_sequence_number": None}


class Reader:
    """A subscription and the messages that wait for it, as many as its quality of service keeps."""

    def __init__(self, node: Node, subscription: Subscription) -> None:
        self.node, self.subscription, qos = node, subscription, subscription.qos_profile
        self.waiting: deque[Any] = deque(maxlen=qos.depth if qos.history == HistoryPolicy.KEEP_LAST else None)
        kind = Subscription.CallbackType.MessageOnly
        self.wants_message_alone = subscription._callback_type == kind

    def take(self) -> None:
        """Give the oldest message to the subscription, as the events executor does."""
        message = self.waiting.popleft()
        given = serialize_message(message) if self.subscription.raw else message
        self.subscription.callback(given if self.wants_message_alone else (given, HANDED_OVER))


class Handover:
    """Hands messages from node to node of one process as they are, in a task of the executor.

    A message goes this way if every reader of its topic is in this process, and the topic has one publisher;
    so it needs no number, by which a reader distinguishes publishers. Otherwise the middleware brings it to
    every reader, as it does before `begin` and for topics that keep messages for later readers: none gets a
    message twice or out of order. Writer and readers share the message: none of them may change it.
    """

    def __init__(self) -> None:
        self._readers: dict[str, list[Reader]] = {}
        self._turns: deque[Reader] = deque()
        self._later: deque[tuple[Node, Callable[[], None]]] = deque()
        self._executor: Executor | None = None
        self.failure: tuple[Node, Exception] | None = None
        """What a reader has raised, and its node; nothing is handed over after it."""

    def begin(self, executor: Executor) -> None:
        """Hand over from now on; the executor calls the readers."""
        self._executor = executor

    def end(self) -> None:
        """Leave all messages to the middleware from now on."""
        self._executor = None

    def add(self, node: Node, subscription: Subscription) -> None:
        """Note a subscription of a node of this process."""
        self._readers.setdefault(subscription.topic_name, []).append(Reader(node, subscription))

    def remove(self, subscription: Subscription) -> None:
        """Forget a subscription before it is destroyed, and what waits for it."""
        for reader in self._readers.get(subscription.topic_name, ()):
            if reader.subscription is subscription:
                reader.waiting.clear()
                self._readers[subscription.topic_name].remove(reader)
                return

    def give(self, publisher: HandingPublisher, message: Any) -> bool:
        """Hand a message over; False if the middleware has to bring it."""
        readers = self._readers.get(publisher.name)
        if self._executor is None or not readers or not _is_private(publisher, readers):
            return False
        self._ask_for_turns(self._executor)
        for reader in readers:
            reader.waiting.append(message)
            self._turns.append(reader)
        return True

    def after(self, node: Node, callback: Callable[[], None]) -> None:
        """Call a function of a node after what is handed over now, and what its readers hand over then."""
        if self._executor is None:
            callback()
            return
        self._ask_for_turns(self._executor)
        self._later.append((node, callback))

    def _ask_for_turns(self, executor: Executor) -> None:
        if not (self._turns or self._later):
            executor.create_task(self._take)

    def _take(self) -> None:
        """Give what waits, in order, and what is handed over meanwhile: a task costs more than a reader."""
        for _ in range(TURNS):
            # One leaves its queue only after its turn: while one has its turn, there is a task.
            if self._turns:
                reader = self._turns[0]
                if reader.waiting:
                    self._call(reader.node, reader.take)
                self._turns.popleft()
            elif self._later:
                self._call(*self._later[0])
                self._later.popleft()
            else:
                return
        if (self._turns or self._later) and self._executor is not None:
            self._executor.create_task(self._take)

    def _call(self, node: Node, callback: Callable[[], None]) -> None:
        if self.failure is None:
            try:
                callback()
            except Exception as error:  # rclpy's events executor crashes if a task raises
                self.failure = node, error


class NodeWithHandover(Node):
    """A node whose messages need not all pass the middleware."""

    handover: Handover | None = None
    """That of the process; None for a node that is alone. It is set before the node has topics."""

    def after_handover(self, callback: Callable[[], None]) -> None:
        """Call a function once the other nodes of the process have answered what this one has published.

        At once where messages pass the middleware, or the node is alone.
        """
        if self.handover is None:
            callback()
        else:
            self.handover.after(self, callback)

    def create_publisher(self, *arguments: Any, **options: Any) -> Publisher:
        """Create a publisher; parameters as in rclpy."""
        handing = {"publisher_class": partial(HandingPublisher, self)}
        return super().create_publisher(*arguments, **handing | options)

    def create_subscription(self, *arguments: Any, **options: Any) -> Subscription:
        """Create a subscription; parameters as in rclpy."""
        subscription = super().create_subscription(*arguments, **options)
        if self.handover is not None:
            self.handover.add(self, subscription)
        return subscription

    def destroy_subscription(self, subscription: Subscription) -> bool:
        """Destroy a subscription; it gets nothing more."""
        if self.handover is not None:
            self.handover.remove(subscription)
        return bool(super().destroy_subscription(subscription))


class HandingPublisher(Publisher):
    """A publisher that hands over what need not pass the middleware.

    Parameters
    ----------
    node : NodeWithHandover
    *arguments, **options : Any
        As in rclpy.
    """

    def __init__(self, node: NodeWithHandover, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._node, self.name = node, self.topic_name
        self._keeps = self.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL

    def publish(self, msg: Any) -> None:
        """Bring a message to all readers of the topic."""
        handover = self._node.handover
        if handover is None or self._keeps or not handover.give(self, msg):
            super().publish(msg)


def _is_private(publisher: Publisher, readers: list[Reader]) -> bool:
    """Whether these are all readers of a topic, and it has no other publisher."""
    return (
        publisher.get_subscription_count() == len(readers)
        and readers[0].subscription.get_publisher_count() == 1
    )
