#!/usr/bin/python3
"""Commands of documents that no other test runs, because their words stand for others or their figures take hours, exist at
least: each `gnomon ...` and `gnomon-bench ...` in a sentence or in a block that is not marked names a subcommand and options
that --help knows. And each block is of a kind that is seen to.

    tests/docs_commands_test.py GNOMON GNOMON_BENCH SOURCES
"""
import functools
import pathlib
import re
import subprocess
import sys

KINDS = {
    "sh": "run by DocsTest",
    "sh slurm": "run by SweepSlurmTest",
    "sh systemd": "run by UnitTest",
    "toml": "read by UnitTest",
    "yaml": "a workflow of GitHub, whose commands are those of the block before",
    "": "what a program prints, or commands that are checked here",
}


@functools.cache
def options(*command):
    """The options and subcommands that a command's help lists."""
    said = subprocess.run([*command, "--help"], capture_output=True, text=True, check=True).stdout
    return set(re.findall(r"(?<![\w-])--?[a-z][a-z-]*", said)), set(re.findall(r"^  ([a-z]+)  ", said.partition("Subcommands:")[2], re.M))


def unknown(programs, text):
    """What a command speaks of that its program does not know. Words after it count as far as they begin with a dash."""
    words = re.sub(r"'[^']*'|\"[^\"]*\"", "", text.replace("'--", "--")).split()
    command = [programs[words[0].rsplit("/", 1)[-1]]]
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


def main():
    gnomon, bench, sources = sys.argv[1:]
    programs = {"gnomon": gnomon, "gnomon-bench": bench}
    sources, count, wrong = pathlib.Path(sources), 0, []
    for document in [sources / "README.md", sources / "ARCHITECTURE.md", *sorted((sources / "docs").glob("*.md"))]:
        for line, text in commands(document):
            count += 1
            wrong += [f"{document}:{line}: `{text}`: there is no {word}" for word in unknown(programs, text)]
    print(*wrong, f"{count} commands", sep="\n")
    return bool(wrong) or count < 50


if __name__ == "__main__":
    sys.exit(main())
