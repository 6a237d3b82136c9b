"""The arms of a world make each tick together, and their time ends with the last of them."""

from soro_core.twin.world import ArmWorld


class Arm:
    """An arm that is due, started and at rest when a test says so."""

    def __init__(self, world, log, name):
        self.log, self.name = log, name
        self.is_started, self.rests, self.due, self.ended = False, False, True, False
        world.arms.append(self)

    def is_due(self):
        return self.due

    def end(self):
        self.ended = True

    def step(self):
        self.log.append(f"{self.name} moves")

    def show(self):
        self.log.append(f"{self.name} shows")

    def join(self):
        self.log.append(f"{self.name} joins")


def two_arms():
    world, log = ArmWorld(), []
    return world, log, Arm(world, log, "left"), Arm(world, log, "right")


def test_time_begins_when_every_arm_has_its_air():
    world, log, left, right = two_arms()
    left.is_started = True
    world.begin()
    assert log == []
    right.is_started = True
    world.begin()
    assert log == ["left joins", "right joins", "left shows", "right shows"]


def test_no_arm_moves_before_the_input_of_every_one_is_there():
    world, log, _, right = two_arms()
    right.due = False
    assert not world.tick()
    assert log == []
    right.due = True
    assert world.tick()
    assert log == ["left moves", "right moves", "left shows", "right shows"]


def test_time_ends_for_all_when_the_last_one_rests():
    world, _, left, right = two_arms()
    left.rests = True
    assert not world.ends()
    assert not left.ended
    right.rests = True
    assert world.ends()
    assert left.ended
    assert right.ended
