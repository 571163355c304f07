"""What can be chosen of a diagnosis, with the defaults and their reasons."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Options:
    """Choices of the method; the defaults are those of the benchmark.

    Attributes:
        seed: of all draws.
        draws: healthy data sets for the calibration.
        alarm_p: probability of a false alarm that is allowed per diagnosis (as calibrated; real
            noise is never quite the model's, so it is far below what users would accept).
        least_gain: robust gain that an alarm needs at least. No model is quite true, and with
            enough data its smallest error is improbable: effects below this are not worth a name.
        least_more: the same for each further cause.
        looked_at: so many of the best are refitted before it is said that nothing is wrong.
        more_p: as ``alarm_p``, for each further cause once there is one.
        rest_p: how improbable what is left after a cause may be before it counts as structure.
        rest_share: how large it must be, relative to what the causes gain.
        structure_p: how improbable whiteness and correlations may be in healthy data.
        family_p: the same for families of unnamed terms.
        block_s: length of the time blocks in which scores are taken as independent.
        price: of each parameter, in twice the log-likelihood (ln of about 400 independent
            samples; Schwarz 1978).
        unnamed_price: what an unexplained term pays beside, since a named cause is more likely.
        margin: two sets of causes are alike if they differ by less (odds of 20 to 1 are 6).
        alike: two causes look alike where the cosine of their sensitivities is at least this.
        alike_margin: sets are alike too if their causes look alike and they differ by less: the
            difference rests on small errors of model and noise then.
        refitted: how many of the best candidates are refitted.
        most_causes: no more are included.
        held_out_share: of the time, where runs carry no flag.
        workers: threads; None: as many as there are processors.
        cache: directory for calibrations; None: none is kept.

    """

    seed: int = 0
    draws: int = 96
    alarm_p: float = 2e-4
    least_gain: float = 25.0
    least_more: float = 20.0
    looked_at: int = 3
    more_p: float = 1e-3
    rest_p: float = 0.01
    rest_share: float = 0.18
    structure_p: float = 1e-4
    family_p: float = 1e-4
    block_s: float = 5.0
    price: float = 6.0
    unnamed_price: float = 9.0
    margin: float = 6.0
    alike: float = 0.9
    alike_margin: float = 18.0
    refitted: int = 8
    most_causes: int = 3
    held_out_share: float = 1.0 / 3.0
    workers: int | None = None
    cache: Path | None = None
