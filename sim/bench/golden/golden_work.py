"""What `odm bench golden` does in each checkout; a script, run there by its path.

    PYTHONPATH=CHECKOUT python -P golden_work.py CHECKOUT FOLDER OUT.json [ITEM ...]
    PYTHONPATH=CHECKOUT python -P golden_work.py CHECKOUT FOLDER time

It knows a checkout by its public names alone, `import roadmap, odm, handover` and the
command `python -m sim`, so that it runs before and after any move inside of them.
Nothing of `sim` is imported: the files beside this one are found by their folder.
"""

import json
import sys
import time
import traceback
from pathlib import Path

sys.path.append(str(Path(__file__).parent))

import golden_commands as commands  # noqa: E402
import golden_names as names  # noqa: E402
import golden_shapes as shapes  # noqa: E402

import roadmap  # noqa: E402

ITEMS = names.ITEMS | shapes.ITEMS | commands.ITEMS
SHORT = "short"  # in place of names: all items but those that take their time
_LONG = (
    "tables", "pictures", "maps", "audits", "runs", "scenes", "replays", "pushed",
    "carried", "recorded", "targets", "two", "workspace",
)  # fmt: skip


def main(words: list[str]) -> None:
    """Do the items that are named, all if none is; write what came of each."""
    checkout, folder, out, *names = words
    if names == [SHORT]:
        names = [name for name in ITEMS if name not in _LONG]
    here = Path(roadmap.__file__).resolve()
    if not here.is_relative_to(Path(checkout).resolve()):
        sys.exit(f"the packages come from {here.parents[1]}, not from {checkout}")
    unknown = [name for name in names if name not in ITEMS]
    if unknown:
        known = ", ".join(ITEMS)
        sys.exit(f"there is no item {unknown[0]!r}; choose some of {known}")
    out = Path(out).absolute()  # the shop moves into its folder
    shop = commands.Shop(Path(folder))
    if out.name == "time":
        import golden_time

        golden_time.answer(shop.loaded(golden_time.scenes.LARGE))
        return
    found = {}
    for name in names or ITEMS:
        print(name, flush=True)
        found[name] = _done(name, shop)
    out.write_text(json.dumps(found), encoding="utf-8")


def _done(name: str, shop: commands.Shop) -> dict:
    """Return the lines of an item, its CPU time, and how it failed, if it did."""
    begun, lines, failed = time.process_time(), [], None
    try:
        for line in ITEMS[name](shop):
            lines.append(line.replace(str(shop.folder), "FOLDER"))
    except Exception as error:
        traceback.print_exc()
        failed = f"{type(error).__name__}: {error}"
    seconds = round(time.process_time() - begun, 2)
    return {"lines": lines, "failed": failed, "seconds": seconds}


if __name__ == "__main__":
    main(sys.argv[1:])
