"""What a scenario can say about gathering: what it can say about Pseudonet, but for its coverage algorithms."""

from typing import Final, Self

from pydantic import model_validator

from protocols.pseudonet.parameters import Parameters as PseudonetParameters

OF_COVERAGE: Final = ("algorithm", "stop_ratio", "patience", "history", "revisits", "k_forced")
"""Parameters of algorithms that gathering does not have."""


class Parameters(PseudonetParameters):
    """Parameters of gathering; those of Pseudonet's coverage algorithms cannot be changed, as none of them is used."""

    @model_validator(mode="after")
    def _not_of_coverage(self) -> Self:
        for name in OF_COVERAGE:
            if getattr(self, name) != type(self).model_fields[name].default:
                raise ValueError(f"{name} is a parameter of the coverage algorithms, which gathering does not use")
        return self
