"""What emulated valves do to the air of a simulated arm, over the plant link."""

from __future__ import annotations

from dataclasses import replace

from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_core.pneumatics import ValveAction, healthy
from soro_core.robot import Robot
from soro_core.twin import Twin, TwinConfig, TwinState
from soro_hardware.emulation.sockets.plant_link import PlantFrame, PlantLinkClient

# Longest wait for a frame of the valves in lockstep, during which the node serves no request.
LINK_WAIT_S = 0.05


class ValveDrive:
    """Moves an arm by a tick with what the valves have done during it.

    Parameters
    ----------
    robot : Robot
        The arm.
    twin : Twin
        Its simulation.
    config : TwinConfig
        With `plant_link`, the socket of the valves, and `plant_chambers`, those of them that are this arm's.

    Raises
    ------
    ConfigError
        If the valves are of another number of chambers.
    HardwareError
        If no emulator listens; in the methods, if it has ended.
    """

    def __init__(self, robot: Robot, twin: Twin, config: TwinConfig) -> None:
        self._twin, self._config = twin, config
        self._lockstep = config.mode == "lockstep"
        # The emulated valves report their action, and receive the pressures that result.
        self._moves_air = config.air == "states"
        self._of_arm = list(config.plant_chambers) or slice(None)
        self._first: PlantFrame | None = None
        self._newest: PlantFrame | None = None  # in real time several ticks may take it
        self._frame: PlantFrame | None = None  # of the tick that has begun
        self._link = PlantLinkClient(config.plant_link)
        if (n := self._pressures(self._link.join(moves_air=False)).size) != len(robot.chamber_names):
            allowed = f"valves of {len(robot.chamber_names)} chambers, as {robot.name} has, not of {n}"
            raise ConfigError("parameters of twin", "plant_link", config.plant_link, allowed)

    def join(self, state: TwinState) -> TwinState:
        """Return the state at the present pressures, from which time begins."""
        return self._twin.at_pressures(state, self._pressures(self._link.join(self._moves_air)))

    def wait(self) -> bool:
        """Wait a little for the frame of the next tick, in lockstep; return whether it is there."""
        self._frame = self._frame or self._link.wait(LINK_WAIT_S)
        return self._frame is not None

    def look(self) -> bool:
        """Read the newest frame, in real time; return whether there is one."""
        self._newest = self._link.latest()
        return self._newest is not None

    def begin(self) -> None:
        """Begin a tick of real time with the newest frame."""
        self._frame = self._newest

    def step(self, state: TwinState) -> TwinState:
        """Return the state a tick later, if one has begun; valves whose air the twin moves are answered."""
        frame, self._frame = self._frame, None
        if frame is None:
            return state
        if self._lockstep:
            self._check_period(frame)
        if not self._moves_air:
            return self._twin.step_pressures(state, self._pressures(frame))
        pressure = state.air.pressure_pa
        if not frame.action.spans:  # the valves have no frame of this twin yet
            action = ValveAction(((self._twin.dt, pressure),), healthy(pressure.size))
        elif self._lockstep:
            action = frame.action
        else:  # the last action counts for the rest of the tick
            action = replace(frame.action, spans=((self._twin.dt, frame.action.spans[-1][1]),))
        state = self._twin.step_valves(state, action)
        if state.status.ok:
            self._link.answer(frame, state.air.pressure_pa)
        return state

    def release(self) -> None:
        """Release the air: the emulated valves do not wait for a twin whose time does not advance."""
        self._link.release()

    def close(self) -> None:
        """Close the socket."""
        self._link.close()

    def _pressures(self, frame: PlantFrame) -> Array:
        """Return the pressures of this arm's chambers among those of the valves."""
        return frame.pressures[self._of_arm] if frame.pressures.size else frame.pressures

    def _check_period(self, frame: PlantFrame) -> None:
        """Refuse valves whose cycle differs from a tick: their answers would come at other times."""
        if self._first is None:
            self._first = frame
        elif frame.sequence == self._first.sequence + 1:
            cycle_ns = frame.time_ns - self._first.time_ns
            if abs(cycle_ns - round(1e9 / self._config.rate_hz)) > 1:
                allowed = f"{1e9 / cycle_ns:g}, the rate of the emulated valves (soro emulate --rate)"
                raise ConfigError("parameters of twin", "rate_hz", self._config.rate_hz, allowed)
