"""Several arms behind one limiter: each commands its own chambers, and a fault of one vents them all."""

from __future__ import annotations

from soro_core.safety.state import SafetyState, Share


def of_arm(state: SafetyState, share: Share) -> SafetyState:
    """Return the state as one arm commands it: with its chambers and its last command."""
    columns, names = list(share.columns), state.monitors.names
    return state._replace(
        setpoint_pa=state.setpoint_pa[columns],
        command_pa=state.command_pa[columns],
        monitors=state.monitors._replace(names=tuple(names[k] for k in columns)),
        command_ns=share.command_ns,
        command_stamp_ns=share.command_stamp_ns,
        command_source=share.command_source,
    )


def with_command(state: SafetyState, share: Share, own: SafetyState) -> SafetyState:
    """Return the state of all arms with the command of one.

    Parameters
    ----------
    state : SafetyState
    share : Share
        That arm's, of the state.
    own : SafetyState
        Of `of_arm`, after the command.
    """
    command_pa = state.command_pa.copy()
    command_pa[list(share.columns)] = own.command_pa
    taken = share._replace(
        command_ns=own.command_ns,
        command_stamp_ns=own.command_stamp_ns,
        command_source=own.command_source,
    )
    shares = tuple(taken if one.arm == share.arm else one for one in state.shares)
    # An arm that has never commanded, and stays empty, does not hold the others back.
    known = [one for one in shares if one.command_ns is not None]
    oldest = min(known, key=lambda one: one.command_ns or 0, default=taken)
    return state._replace(
        command_pa=command_pa,
        rejected=own.rejected,
        shares=shares,
        command_ns=oldest.command_ns,
        command_stamp_ns=oldest.command_stamp_ns,
        command_source=oldest.command_source,
    )


def kept(shares: tuple[Share, ...], oldest_ns: int) -> tuple[Share, ...]:
    """Return the shares behind a reset: commands from before a time [ns] age no further, so do not trip."""
    stale = [one.command_ns is not None and one.command_ns < oldest_ns for one in shares]
    return tuple(
        one._replace(command_ns=None) if old else one for one, old in zip(shares, stale, strict=True)
    )


def commands_of(state: SafetyState) -> str:
    """Return who commands pressure: the arms by name, or the source of a single one."""
    asking = [one for one in state.shares if state.command_pa[list(one.columns)].any()]
    return ", ".join(f"{one.arm} ({one.command_source})" for one in asking) or state.command_source
