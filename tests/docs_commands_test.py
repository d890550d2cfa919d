#!/usr/bin/python3
"""Commands that documents speak of in sentences and in blocks that are not marked. Each names a subcommand and options that
--help knows; and each that says all it needs is run, on a small world and shortened: what it prints in full takes hours. Each
block is of a kind that is seen to. docs/configuration.md has the settings of the maps, and their values, as they are.

    tests/docs_commands_test.py SOURCES     in a folder with hills.asc, hills.world and flight.tum; programs on PATH
"""
import functools
import pathlib
import re
import shlex
import subprocess
import sys
import tomllib

KINDS = {
    "sh": "run by DocsTest",
    "sh slurm": "run by SweepSlurmTest",
    "sh systemd": "run by UnitTest",
    "toml": "read by UnitTest",
    "yaml": "a workflow of GitHub, whose script DocsTest runs",
    "": "what a program prints, or commands that are checked here",
}


@functools.cache
def options(*command):
    """The options and subcommands that a command's help lists."""
    said = subprocess.run([*command, "--help"], capture_output=True, text=True, check=True).stdout
    return set(re.findall(r"(?<![\w-])--?[a-z][a-z-]*", said)), set(re.findall(r"^  ([a-z]+)  ", said.partition("Subcommands:")[2], re.M))


def unknown(text):
    """What a command speaks of that its program does not know. Words after it count as far as they begin with a dash."""
    words = re.sub(r"'[^']*'|\"[^\"]*\"", "", text.replace("'--", "--")).split()
    command = words[:1]
    rest = words[1:]
    known, subcommands = options(*command)
    while subcommands and rest:
        at = next((i for i, word in enumerate(rest) if not word.startswith("-")), None)
        if at is None or rest[at] not in subcommands:
            if len(command) == 1:
                yield rest[0]
            break
        command.append(rest.pop(at))
        more, subcommands = options(*command)
        known = known | more
    for word in rest:
        option = re.match(r"--?[a-z][a-z-]*", word)
        if option and option[0] not in known:
            yield option[0]


# What stands for something, and what is shortened: by the word itself, or by the option before it.
WORDS = {"DIR": "dump", "FILE": "some.sqlite", "SECONDS": "60", "K": "16", "dem.tif": "hills.asc"}
VALUES = {"--path": "flight.tum", "--seconds": "1", "--sessions": "4", "--idle": "4"}
LEFT_OUT = ("--movers", "--bounds", "--every")
FRAMES = {"gnomon": "0:3", "gnomon-bench": "3", "soak": "10"}
MORE = {
    "replay": ["--frames 0:3"],
    "lab": ["--frames 0:3", "--every 2", "--methods gnomon"],
    "tune": ["--frames 0:3", "--every 2", "--trials 2"],
    "stress": ["--resolution 128", "--case path"],
    "gnomon-bench": ["--frames 3"],
}


def shortened(text):
    """The command on the small world; none where it does not say all that it needs."""
    if "..." in text or re.search(r"\S {3,}\S", text):  # left out; explained in a column beside it
        return None
    words = shlex.split(text)
    called = [word for word in words[:2] if not word.startswith("-")]
    if not any(word.endswith(".world") for word in words):
        return None
    short = []
    for before, word in zip(["", *words], words):
        if before in LEFT_OUT or word in LEFT_OUT:
            continue
        if before == "--frames":
            word = next(FRAMES[name] for name in reversed(called) if name in FRAMES)
        word = VALUES.get(before, WORDS.get(word, word))
        if re.search(r"(?:^|/)[A-Z]+$", word):
            return None
        own = before == "-o" or word.endswith((".toml", ".tum"))
        short.append(word if own or not word.endswith(".world") else "hills.world")
    for more in MORE.get(called[-1] if called[0] == "gnomon" else called[0], []):
        option = more.split()[0]
        if option not in short and not (option in ("--case", "--methods") and {"--prefetch", "--occlusion"} & set(short)):
            short += more.split()
    return short if called[-1] not in ("replay", "lab", "tune") or "--path" in short else None


def commands(document):
    """Line and text of each command; in a block, lines that are indented belong to the command above them."""
    name, kind, found, prose = r"gnomon(?:-bench)?\b", None, [], []
    above = None  # the block's newest command
    for number, line in enumerate(document.read_text(encoding="utf-8").split("\n"), 1):
        fence = line.startswith("```")
        if fence:
            kind, above = line[3:] if kind is None else None, None
            if kind is not None and kind not in KINDS:
                sys.exit(f"{document}:{number}: a block of kind '{kind}'; there are {', '.join(filter(None, KINDS))}")
        elif kind == "" and re.match(name, line):
            above = [number, line]
            found.append(above)
        elif kind == "" and line.startswith(" ") and above:
            above[1] += " " + line.strip()
        prose.append("" if fence or kind is not None else line)
    text = "\n".join(prose)
    return found + [(text.count("\n", 0, span.start()) + 1, span[1]) for span in re.finditer(rf"`({name}\s[^`]*)`", text)]


def unlike(document):
    """Settings that a document's table has otherwise than a file that gnomon tune wrote before it changed any."""
    search = "gnomon tune hills.world --path flight.tum --frames 0:3 --every 2 --far 200 --max-error 100 --trials 1 -o start.toml"
    subprocess.run(search.split(), capture_output=True, check=True)
    kept = tomllib.loads(pathlib.Path("start.toml").read_text(encoding="utf-8"))["settings"]
    real = {name: "none" if value == [] else str(value).lower() for name, value in kept.items()}
    told = dict(re.findall(r"^\| `([a-z-]+)` \| ([^|]*) \|", document.read_text(encoding="utf-8"), re.M))
    return [f"{document}: {name} is {told.get(name)} there, and {real.get(name)} in truth"
            for name in sorted(real.keys() | told.keys()) if real.get(name) != told.get(name)]


def main():
    sources, count, wrong, ran = pathlib.Path(sys.argv[1]), 0, [], set()
    for document in [sources / "README.md", sources / "ARCHITECTURE.md", *sorted((sources / "docs").glob("*.md"))]:
        for line, text in commands(document):
            count += 1
            wrong += [f"{document}:{line}: `{text}`: there is no {word}" for word in unknown(text)]
            short = shortened(text)
            if short and tuple(short) not in ran:
                ran.add(tuple(short))
                said = subprocess.run(short, capture_output=True, text=True, check=False)
                if said.returncode != 0:
                    wrong.append(f"{document}:{line}: `{text}` as `{shlex.join(short)}`: {said.stderr or said.stdout}")
    wrong += unlike(sources / "docs/configuration.md")
    print(*wrong, f"{count} commands, {len(ran)} of them run", sep="\n")
    return bool(wrong) or count < 50 or len(ran) < 20


if __name__ == "__main__":
    sys.exit(main())
