"""Parameters of the viewer."""

from __future__ import annotations

from pydantic import Field

from soro_core.run_keys import StartKeys


class ViewerConfig(StartKeys):
    """Parameters of the viewer."""

    robot: str = Field("tue_three_bellow", description="robot file, or the name of a shipped one")
    payload_kg: float = Field(0.0, ge=0, le=100, description="payload drawn at the tip [kg]; 0: none")
    mounted_on: str = Field("", description="as of the twin: the arm at whose tip this one is drawn")
    bodies_file: str = Field("", description="as of the twin: what is drawn beside the arms; empty: nothing")
    rate_hz: float = Field(20.0, ge=1, le=60, description="pictures a second, at most")
    trail_s: float = Field(10.0, ge=1, le=120, description="length of trails and plots [s]")
    port: int = Field(8080, ge=1024, le=65535, description="port on 127.0.0.1; the next free one if taken")
    address_file: str = Field(
        "", description="file that takes the address with its token, instead of the terminal"
    )
