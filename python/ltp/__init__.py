"""ltp: explains periodic and hybrid mechanical systems from their recordings.

Owns the public names. Give it the equations you believe (`Model`) and the data you measured (`Recording`); `simulate`
runs the equations, `diagnose` locates where the two disagree, names the physics that was left out and shows the fit
improve.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ltp import metrics, signals, zoo
from ltp._ltp import ConvergenceError, InputError
from ltp.closed_loop import (
    Case,
    Certificate,
    ClosedOrbit,
    Lifted,
    Run,
    SimulationCost,
    StageOutcome,
    Tracked,
    certify,
    close,
    simulation_cost,
    track,
)
from ltp.control import Objective, closed_loop_eigenvalues, control
from ltp.cycle import CycleEvent, Domain, LimitCycle, Other, cycle
from ltp.diagnose import (
    Candidate,
    Diagnosis,
    Effect,
    Estimate,
    Fit,
    FitRow,
    Law,
    Location,
    ParameterChange,
    diagnose,
)
from ltp.diagnose_many import JobError, JobResult, diagnose_many
from ltp.feedback import Feedback
from ltp.feedforward import Reference, feedforward
from ltp.harmonic import EventTime, HarmonicMap, harmonic_map
from ltp.htf import Htf
from ltp.identify import Rest, identify, rests
from ltp.isolability import Isolability, isolability
from ltp.jobs import Job
from ltp.linearize import Jump, LtpSystem, linearize
from ltp.model import Model
from ltp.periodic import Floquet, LiftedMode, Transverse
from ltp.recording import Recording
from ltp.simulate import Event, Stop, Trajectory, simulate
from ltp.unclocked import (
    Cycle,
    CycleAverage,
    HeldOut,
    PeriodicArx,
    Phase,
    Ratio,
    SectionMap,
    StepResponse,
    cycle_average,
    identify_arx,
    identify_map,
    phase_from_events,
    switch_times,
)

__all__ = [
    "Candidate",
    "Case",
    "Certificate",
    "ClosedOrbit",
    "ConvergenceError",
    "Cycle",
    "CycleAverage",
    "CycleEvent",
    "Diagnosis",
    "Domain",
    "Effect",
    "Estimate",
    "Event",
    "EventTime",
    "Feedback",
    "Fit",
    "FitRow",
    "Floquet",
    "HarmonicMap",
    "HeldOut",
    "Htf",
    "InputError",
    "Isolability",
    "Job",
    "JobError",
    "JobResult",
    "Jump",
    "Law",
    "Lifted",
    "LiftedMode",
    "LimitCycle",
    "Location",
    "LtpSystem",
    "Model",
    "Objective",
    "Other",
    "ParameterChange",
    "PeriodicArx",
    "Phase",
    "Ratio",
    "Recording",
    "Reference",
    "Rest",
    "Run",
    "SectionMap",
    "SimulationCost",
    "StageOutcome",
    "StepResponse",
    "Stop",
    "Tracked",
    "Trajectory",
    "Transverse",
    "certify",
    "close",
    "closed_loop_eigenvalues",
    "control",
    "cycle",
    "cycle_average",
    "diagnose",
    "diagnose_many",
    "feedforward",
    "harmonic_map",
    "identify",
    "identify_arx",
    "identify_map",
    "isolability",
    "linearize",
    "metrics",
    "phase_from_events",
    "rests",
    "signals",
    "simulate",
    "simulation_cost",
    "switch_times",
    "track",
    "zoo",
]


__version__: str

if not TYPE_CHECKING:  # to a type checker, a module with `__getattr__` seems to have every name

    def __getattr__(name: str) -> str:
        """The version, looked up in the installed package's metadata when it is asked for."""
        if name == "__version__":
            from importlib.metadata import version

            return version("ltp-dynamics")
        raise AttributeError(f"module 'ltp' has no attribute {name!r}")
