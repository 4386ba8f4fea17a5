"""JSON Schema of scene files, with the defaults of all optional keys."""

from typing import Any

import msgspec

from whisker_sim.runs import AnyScene
from whisker_sim.scene import SIMULATIONS

_REFERENCE = "#/$defs/"


def scene_schema() -> dict[str, Any]:
    """The schema (draft 2020-12) of every kind of scene that is written as a file, which has a name.

    Its keyword `x-settings` lists the settings that a name stands for.
    """
    files = [kind for kind in AnyScene.__args__ if "name" in kind.__struct_fields__]
    kinds, definitions = msgspec.json.schema_components(files, ref_template=_REFERENCE + "{name}")
    settings = {name: msgspec.to_builtins(simulation) for name, (_, simulation) in SIMULATIONS.items()}
    for kind in kinds:
        definitions[kind["$ref"].removeprefix(_REFERENCE)]["properties"]["simulation"]["x-settings"] = settings
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "Scene", "anyOf": list(kinds), "$defs": definitions}
