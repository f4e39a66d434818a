"""The words of a command line before they are parsed, and what is said of them."""

import re

# options that may stand alone, and the ending that a file behind them often has
_TARGETS = {"--json": ".json", "--markdown": ".md"}
# an argument that may be left out, and the flag that then stands in its place
_INSTEAD = {"build": "--robot", "replay": "--frames"}


def with_targets(words: list[str], group: object) -> list[str]:
    """Let `--json` stand alone, or with any file behind it.

    The word behind it is the file, unless it begins with "-" or the command would then
    lack an argument: `odm info --json maps/a` prints, `odm info maps/a --json out`
    writes.

    Args:
        words: Of the command line, behind `odm`.
        group: All commands, as typer made it.
    """
    result, at = [], 0
    while at < len(words):
        word, at = words[at], at + 1
        if word in _TARGETS:
            after = words[at] if at < len(words) else ""
            named = after == "-" or after.endswith(_TARGETS[word])
            if after and not named and not after.startswith("-"):
                named = not _is_wanted(words[: at - 1], words[at + 1 :], group)
            if named:
                word, at = f"{word}={after}", at + 1
            else:
                word += "=-"
        result.append(word)
    return result


def _is_wanted(before: list[str], behind: list[str], group: object) -> bool:
    """Return whether a command needs the word between as an argument by its place."""
    command, rest = _command_of([*before, *behind], group)
    if hasattr(command, "commands"):
        return not (rest and rest[0].startswith("-"))  # the word names the command
    takes = {
        name: 0 if getattr(p, "is_flag", False) else p.nargs
        for p in command.params
        for name in (*p.opts, *p.secondary_opts)
        if name.startswith("-")
    }
    given, at = 0, 0
    while at < len(rest):
        one, at = rest[at], at + 1
        if one in _TARGETS:
            at += at < len(rest) and (
                rest[at] == "-" or rest[at].endswith(_TARGETS[one])
            )
        elif one.startswith("-"):
            at += takes.get(one, 0)
        else:
            given += 1
    places = [p for p in command.params if p.param_type_name == "argument"]
    instead = _INSTEAD.get(command.name)
    missing = given < len(places)
    return missing and instead not in rest


def _command_of(words: list[str], group: object) -> tuple[object, list[str]]:
    """Return the command that the first words name, as far as they do, and the rest."""
    command, rest = group, words
    while hasattr(command, "commands") and rest and rest[0] in command.commands:
        command, rest = command.commands[rest[0]], rest[1:]
    return command, rest


_WRONG = re.compile(r"Invalid value for '?([^':]*)'?: (.*)")
_COUNT = re.compile(r"Option '([^']*)' requires (\w+) arguments?")
_KINDS = {  # what typer and its pydantic say, and what we do
    "valid float": "give a number, such as 0.5",
    "valid number": "give a number, such as 0.5",
    "valid integer": "give a whole number, such as 10",
}
_BOUND = re.compile(r"should be (?:greater|less) than or equal to (\S+)")


def mistake(error: Exception, words: list[str], group: object) -> str | None:
    """Return one sentence for what typer says of wrong words, None for other errors."""
    if not hasattr(error, "format_message"):
        return None
    if type(error).__name__ == "NoArgsIsHelpError":
        return ""  # the help is out already: it was printed where it was asked for
    text = " ".join(error.format_message().split())
    context = getattr(error, "ctx", None)
    helped = f"{context.command_path} --help" if context else "odm --help"
    if found := _WRONG.match(text):
        name, why = found.groups()
        for kind, remedy in _KINDS.items():
            if kind in why:
                why = remedy
        if bound := _BOUND.search(why):
            side = "or more" if "greater" in why else "or less"
            why = f"give {bound[1].rstrip('.')} {side}"
        value = _value_of(name, words)
        told = "" if value is None else f" is {value!r}"
        return f"odm: {name}{told}: {why[:1].lower()}{why[1:].rstrip('.')}"
    if found := _COUNT.match(text):
        name, count = found.groups()
        if count == "an":
            return f"odm: {name} stands alone; give a value behind it"
        behind = _metavar(name, _command_of(words, group)[0])
        return f"odm: {name} needs {count} values behind it: {behind}"
    text = text.removeprefix("Invalid value: ").rstrip(".?").replace(". Did", "; did")
    return f"odm: {text[:1].lower()}{text[1:]}; see {helped}"


def nothing_given(words: list[str]) -> str:
    """Return a sentence for an empty word, as of a shell's unset $NAME; "": none."""
    for at, word in enumerate(words):
        flag, _, value = word.partition("=")
        before = words[at - 1] if at else ""
        if flag == "--token" or before == "--token":
            continue  # the one that may be empty, which its command looks at
        if word == "" and before.startswith("--"):
            return f"odm: {before} is '': give a value behind it, or leave it out"
        if word == "":
            return "odm: an empty word '' was given; is a variable of your shell unset?"
        if flag.startswith("--") and value == "" and word.endswith("="):
            return f"odm: {flag} is '': give a value behind it, or leave it out"
    return ""


def _metavar(name: str, command: object) -> str:
    """Return what stands behind a flag in the help, or where to look."""
    for one in getattr(command, "params", ()):
        if name in one.opts and one.metavar:
            return one.metavar
    return "see --help"


def _value_of(name: str, words: list[str]) -> str | None:
    """Return what stands behind a flag the last time, None where it cannot be told."""
    for at in reversed(range(len(words))):
        flag, equals, value = words[at].partition("=")
        if flag in name.split(" / "):
            return value if equals else next(iter(words[at + 1 :]), None)
    return None
