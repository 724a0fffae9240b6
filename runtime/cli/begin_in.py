"""Words of the command line for a run that begins in a saved map."""

from pathlib import Path
from typing import Annotated

import typer

BeginIn = Annotated[
    Path | None, typer.Option("--map", metavar="MAP", help="saved map to start in; the file is never altered")
]
LocaliseOnly = Annotated[bool, typer.Option("--localise-only", help="only localise in the map: no new map is written")]
StartAt = Annotated[
    str | None, typer.Option("--start-at", metavar="X,Y,YAW", help="where the rover is in the map, m and rad")
]
