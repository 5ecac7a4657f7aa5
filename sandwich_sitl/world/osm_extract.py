"""A process of its own that reads an OpenStreetMap extract with libosmium: FILE FORMAT MAX_OBJECTS, lines of JSON out.

libosmium trusts the strings of a file (one with a zero byte in it can end the process), so it is kept at arm's length: its
memory, its time and its answer are bounded, and a crash is an answer too. Each line is an object: `name`, `tags`, and
either `wkb` (hexadecimal, degrees), `corners` of a closed way, or the reason why it is `unusable`. The last line is
`{"end": null}`, or `{"end": reason}` where the file is refused.
"""

import json
import os
import resource
import sys
from collections.abc import Iterator
from typing import Any

import osmium
from osmium.filter import KeyFilter

KEY = "building"
MAX_MEMORY_BYTES = 4 * 2**30  # of address space, threads' arenas included
_MAX_ANSWER_BYTES = 256 * 2**20


def main() -> None:
    """Print what the file holds."""
    path, file_format, most_objects = sys.argv[1], sys.argv[2], int(sys.argv[3])
    _limit(resource.RLIMIT_AS, MAX_MEMORY_BYTES)
    _limit(resource.RLIMIT_CORE, 0)
    os.environ["OSMIUM_POOL_THREADS"] = "1"  # each thread takes address space
    print(json.dumps({"end": _answer(osmium.io.File(path, file_format), most_objects)}))


def _limit(kind: int, most: int) -> None:
    _, allowed = resource.getrlimit(kind)
    least = most if allowed == resource.RLIM_INFINITY else min(most, allowed)
    resource.setrlimit(kind, (least, least))


def _answer(file: osmium.io.File, most_objects: int) -> str | None:
    """Print the buildings; None, or the reason why the file is refused."""
    written = 0
    try:
        for count, _ in enumerate(osmium.FileProcessor(file), 1):
            if count > most_objects:
                return f"has more than {most_objects} objects"
        for item in _buildings(file):
            line = json.dumps(item)
            written += len(line)
            if written > _MAX_ANSWER_BYTES:
                return f"has buildings of more than {_MAX_ANSWER_BYTES} bytes"
            print(line)
    except (RuntimeError, ValueError, osmium.InvalidLocationError) as error:
        return f"is no complete OpenStreetMap extract ({' '.join(str(error).split())[:160]})"
    except MemoryError:
        return f"needs more than {MAX_MEMORY_BYTES} bytes of memory"
    return None


def _buildings(file: osmium.io.File) -> Iterator[dict[str, Any]]:
    """Ways and relations as they come, and each area that libosmium puts together from them, under the same name."""
    to_wkb = osmium.geom.WKBFactory()
    for item in osmium.FileProcessor(file).with_areas(KeyFilter(KEY)).with_filter(KeyFilter(KEY)):
        if isinstance(item, osmium.osm.Area):
            if item.num_rings()[0]:
                name = f"{'way' if item.from_way() else 'relation'} {item.orig_id()}"
                yield {"name": name, "tags": dict(item.tags), "wkb": to_wkb.create_multipolygon(item)}
        elif isinstance(item, osmium.osm.Way):
            yield {"name": f"way {item.id}", "tags": dict(item.tags)} | _corners(item)
        elif isinstance(item, osmium.osm.Relation) and item.tags.get("type") == "multipolygon":
            reason = "is incomplete in the extract, or its ways do not close"
            yield {"name": f"relation {item.id}", "tags": dict(item.tags), "unusable": reason}


def _corners(way: osmium.osm.Way) -> dict[str, Any]:
    if not way.is_closed():
        return {"unusable": "is not closed"}
    if not all(node.location.valid() for node in way.nodes):
        return {"unusable": "has corners outside the extract"}
    corners = [(node.lon, node.lat) for node in way.nodes]
    return {"corners": corners} if len(set(corners)) >= 3 else {"unusable": "has no area"}


if __name__ == "__main__":
    main()
