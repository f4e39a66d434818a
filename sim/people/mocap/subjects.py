"""Whose a body is: a namespace, as in `Eve:RSHO`, tells people of one file apart."""

from collections.abc import Iterable, Mapping

from sim.people.mocap.tracks import BadMocap


def split(name: str) -> tuple[str, str]:
    """Return the subject, "" without one, and the plain name, both in lower case."""
    subject, colon, _ = name.partition(":")
    subject = _tidy(subject).removeprefix("global angle ") if colon else ""
    return subject, _tidy(name.rsplit(":", 1)[-1])


def _tidy(name: str) -> str:
    """Return a name in lower case, without what exporters write otherwise."""
    name = " ".join(name.replace("_", " ").split()).lower()
    return name.replace("bip001 ", "bip01 ").removeprefix("def-")


class Roll:
    """The names of a recording by subject.

    A namespace of a single body is no subject: Vicon puts each object in its own.

    Attributes:
        source: Name of the file, for messages.
        subjects: Subject in lower case -> as the recording spells it.
    """

    def __init__(self, source: str, names: Iterable[str]) -> None:
        """Count the bodies of each namespace; the first of one name counts."""
        self.source = source
        self._names: dict[tuple[str, str], str] = {}
        for name in names:
            self._names.setdefault(split(name), name)
        self.subjects: dict[str, str] = {}
        bodies = [s for (s, plain) in self._names if s and not plain.endswith(" end")]
        for (subject, _), name in self._names.items():
            if bodies.count(subject) > 1:
                self.subjects.setdefault(subject, name.partition(":")[0].strip())

    def find(self, wanted: str) -> list[str]:
        """Return the bodies that a mapping can mean; more than one: it is not said.

        A name without a namespace means that of any subject; one with a namespace
        means its subject's, or a body without any.
        """
        subject, plain = split(wanted)
        here = {s: name for (s, p), name in self._names.items() if p == plain}
        if subject in here:
            return [here[subject]]
        if subject:
            return [here[""]] if "" in here else []
        return list(here.values())

    def groups(self) -> list[dict[str, str]]:
        """Return plain name -> body of each subject, and last of what is nobody's.

        What is nobody's is in all groups: of a file without subjects there is one.
        """
        loose: dict[str, str] = {}
        for (subject, plain), name in self._names.items():
            if subject not in self.subjects:
                loose.setdefault(plain, name)
        groups = [
            {p: name for (s, p), name in self._names.items() if s == subject}
            for subject in self.subjects
        ]
        return [*(loose | one for one in groups), loose]

    def of(self, names: Iterable[str]) -> list[str]:
        """Return the subjects of these bodies, as the recording spells them."""
        found = dict.fromkeys(split(name)[0] for name in names)
        return [self.subjects[s] for s in found if s in self.subjects]

    def resolve(self, mapping: Mapping[str, str], label: str) -> dict[str, str]:
        """Return joint -> body for a mapping whose names are all there."""
        chosen = {}
        for joint, wanted in mapping.items():
            first, *others = self.find(wanted)
            if others:
                raise BadMocap(
                    f"{label} gives {wanted!r} for {joint}, and {self.source} holds "
                    f"{' and '.join((first, *others))}; write whose it is, as "
                    f'{joint} = "{others[-1]}"'
                )
            chosen[joint] = first
        nobodys = [n for joint, n in mapping.items() if ":" not in chosen[joint]]
        asked = {split(n)[0]: n.partition(":")[0].strip() for n in nobodys if ":" in n}
        found = {split(s + ":")[0]: s for s in self.of(chosen.values())}
        if len(whose := [*(asked | found).values()]) > 1:
            raise BadMocap(
                f"{label} mixes the bodies of {' and '.join(whose)}, which are of one "
                f"person each; write those of one, as of {whose[0]}, for all joints"
            )
        return chosen
