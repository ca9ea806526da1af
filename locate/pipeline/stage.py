"""A stage of a run, and all that its result depends on."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType

from locate import __version__
from locate.pipeline.fingerprint import digest, fingerprint_code


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One stage of a run.

    Attributes:
        name: Of the stage.
        inputs: What its result depends on besides the next two; JSON-able.
        after: The stages whose results it reads.
        code: The modules that make the result; it depends on them and on all that they import of
            this program.
    """

    name: str
    inputs: Mapping[str, object]
    after: tuple[str, ...] = ()
    code: Sequence[ModuleType] = ()

    def fingerprint(self, earlier: Mapping[str, str]) -> str:
        """A digest of all that the result depends on.

        Args:
            earlier: Fingerprints of the stages in `after`, by name.
        """
        depends = {
            "stage": self.name,
            "version": __version__,
            "inputs": dict(self.inputs),
            "code": [fingerprint_code(module.__name__) for module in self.code],
            "after": [earlier[name] for name in self.after],
        }
        return digest(json.dumps(depends, sort_keys=True).encode())
