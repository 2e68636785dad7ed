"""A stand-in for the program satgs that keeps its contract with the engines and does no work.

It is called as `satgs tile run RUN ID | --index N`, `satgs tile blend RUN ID`, `satgs tile status RUN --json`,
`satgs mosaic RUN`. RUN/behaviour.json says how tiles behave: {"ID": {"seconds": [60, 1], "exits": [1, 1, 0]}} has the
duration and the exit code of each attempt; the last ones hold for all further attempts. "lacks" is what exit code 75
complains about, "blend" the exit code of blending. Each attempt adds a line to
RUN/attempts.log.
"""

import argparse
import fcntl
import json
import os
import signal
import sys
import threading
import time
from pathlib import Path


def main() -> int:
    args = parse()
    run = args.run
    plan = json.loads((run / "tiles.json").read_text())
    signal.signal(signal.SIGTERM, lambda *_: os._exit(130))
    if getattr(args, "exit_with_parent", False):
        threading.Thread(target=watch_parent, daemon=True).start()
    if args.command == "mosaic":
        return mosaic(run, plan)
    if args.task == "status":
        print(json.dumps({"tiles": [{"id": tile["id"], "state": state(run, tile)} for tile in plan["tiles"]]}))
        return 0
    if args.index is not None:
        args.id = plan["tiles"][args.index]["id"]
    tile = next((tile for tile in plan["tiles"] if tile["id"] == args.id), None)
    if tile is None:
        return fail(2, f"the plan has no tile `{args.id}`")
    return run_tile(run, tile, args.events) if args.task == "run" else blend(run, tile, args.without)


def parse() -> argparse.Namespace:
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--exit-with-parent", action="store_true")
    common.add_argument("--events", action="store_true")
    common.add_argument("--threads", type=int)
    parser = argparse.ArgumentParser()
    commands = parser.add_subparsers(dest="command", required=True)
    tasks = commands.add_parser("tile").add_subparsers(dest="task", required=True)
    for task in ("run", "blend"):
        job = tasks.add_parser(task, parents=[common])
        job.add_argument("run", type=Path)
        job.add_argument("id", nargs="?")
        job.add_argument("--index", type=int)
        if task == "blend":
            job.add_argument("--without", action="append", default=[])
    status = tasks.add_parser("status")
    status.add_argument("run", type=Path)
    status.add_argument("--json", action="store_true")
    mosaic = commands.add_parser("mosaic", parents=[common])
    mosaic.add_argument("run", type=Path)
    return parser.parse_args()


def watch_parent() -> None:
    while os.read(0, 4096):
        pass
    time.sleep(2.0)  # A checkpoint is written before the lock is released.
    os._exit(130)


def fail(code: int, text: str) -> int:
    print(f"error: {text}", file=sys.stderr)
    return code


def log(run: Path, *words: object) -> None:
    with (run / "attempts.log").open("a") as file:
        file.write(" ".join(map(str, words)) + "\n")


def event(shown: bool, **fields: object) -> None:
    if shown:
        print(json.dumps(fields), flush=True)


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_suffix(f".{os.getpid()}.tmp")
    temporary.write_text(text)
    temporary.rename(path)


def state(run: Path, tile: dict) -> str:
    folder = run / "tiles" / tile["id"]
    try:
        done = json.loads((folder / "done.json").read_text())
        if done["input_hash"] == tile["input_hash"] and (folder / "dsm.tif").exists():
            return "done"
    except (OSError, ValueError, KeyError):
        pass
    return "failed" if (folder / "failed.json").exists() else "planned"


def of_attempt(values: list, before: int) -> float:
    return values[min(before, len(values) - 1)]


def behaviour_of(run: Path, tile: dict) -> dict:
    path = run / "behaviour.json"
    return json.loads(path.read_text()).get(tile["id"], {}) if path.exists() else {}


def run_tile(run: Path, tile: dict, events: bool) -> int:
    folder = run / "tiles" / tile["id"]
    if state(run, tile) == "done":
        return 0
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return fail(1, f"another satgs is at work in `{folder}`")
        behaviour = behaviour_of(run, tile)
        lines = (run / "attempts.log").read_text().splitlines() if (run / "attempts.log").exists() else []
        before = sum(line.startswith(f"tile {tile['id']} ") for line in lines)
        log(run, "tile", tile["id"], os.getpid(), os.getppid())
        started = time.monotonic()
        event(events, event="started", stage="training", total=10)
        for done in range(10):
            time.sleep(of_attempt(behaviour.get("seconds", [0.05]), before) / 10)
            event(events, event="advanced", done=done + 1, status="loss 0.03")
        code = of_attempt(behaviour.get("exits", [0]), before)
        if code < 0:
            os.kill(os.getpid(), -code)
        if code not in (0, 3):
            print("\n".join(f"line {n}" for n in range(30)), file=sys.stderr)
            reason = f"attempt {before + 1} of {tile['id']} is meant to fail"
            if code == 75:
                reason = f"tile `{tile['id']}` needs 9 MB of {behaviour.get('lacks', 'memory')}, this machine has 8 MB"
            write(folder / "failed.json", json.dumps({"reason": reason}))
            return fail(code, reason)
        write(folder / "dsm.tif", tile["id"])
        (folder / "failed.json").unlink(missing_ok=True)
        seconds = time.monotonic() - started
        files = {"dsm.tif": {"bytes": len(tile["id"])}}
        done = {"input_hash": tile["input_hash"], "seconds": seconds, "files": files}
        write(folder / "done.json", json.dumps(done))
        event(events, event="finished")
        event(events, event="summary", summary={"seconds": seconds})
        return code


def blend(run: Path, tile: dict, without: list[str]) -> int:
    used = [tile["id"], *(name for name in tile["neighbours"] if name not in without)]
    for name in used:
        if not (run / "tiles" / name / "done.json").exists():
            return fail(1, f"tile `{name}` is not done")
    if "blend" in behaviour_of(run, tile):
        log(run, "blend", tile["id"])
        return fail(behaviour_of(run, tile)["blend"], f"tile `{tile['id']}` is not to be blended")
    path = run / "mosaic" / f"{tile['id']}.json"
    text = json.dumps({"tiles": used})
    if not path.exists() or path.read_text() != text:
        log(run, "blend", tile["id"])
        write(path, text)
    return 0


def mosaic(run: Path, plan: dict) -> int:
    done = [tile for tile in plan["tiles"] if state(run, tile) == "done"]
    absent = [tile["id"] for tile in plan["tiles"] if tile not in done]
    if not done:
        return fail(1, f"no tile of `{run}` is done")
    for tile in list(done):
        if blend(run, tile, absent) != 0:
            done.remove(tile)
            absent.append(tile["id"])
    log(run, "mosaic")
    write(run / "dsm.tif", " ".join(tile["id"] for tile in done))
    return 3 if absent else 0


sys.exit(main())
