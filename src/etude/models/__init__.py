"""Models: structures for every kind of robot, their members, scores and store."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.models.accuracy import (
        NORMAL_95,
        TRANSIENT_S,
        figures,
        prediction_score,
        score_trajectories,
        while_any_moves,
    )
    from etude.models.change.change_detection import first_alarm
    from etude.models.change.diagnosis import SENSOR, Cause
    from etude.models.change.evidence import ChangeTest, change_test, drift_onset
    from etude.models.change.payload_estimate import (
        Load,
        about_origin,
        apparent_loads,
        load_forecast,
        load_of,
        whole_mass,
    )
    from etude.models.config import USUAL_COMMANDS, ModelConfig, Structure
    from etude.models.data.as_log import followed
    from etude.models.data.cross_validation import (
        COUNT,
        EVERY,
        FIRST,
        block_masks,
        contiguous_blocks,
        fold_numbers,
        near_times,
        split_blocks,
    )
    from etude.models.data.fit_data import (
        LARGEST_FLOOR,
        Folds,
        fit_data,
        in_order,
        rows_of,
        trained_process,
        units_of,
    )
    from etude.models.forms import (
        kernel_metadata,
        kernel_of,
        posterior_arrays,
        posterior_metadata,
        posterior_of,
    )
    from etude.models.gp.basis_posterior import BasisPosterior
    from etude.models.gp.bayesian_linear import BayesianLinear
    from etude.models.gp.cholesky import JitterWarning, factorise
    from etude.models.gp.exact import ExactGP, ExactPosterior, posterior_given
    from etude.models.gp.hyperparameters import Prior, fit, initial_gp
    from etude.models.gp.inducing import FixedInducing, Form, InducingGP
    from etude.models.gp.inducing_training import fit_inducing, initial_inducing
    from etude.models.gp.kernel_algebra import Kernel
    from etude.models.gp.kernels import Linear, SquaredExponential, ard_se, structured
    from etude.models.gp.minimize import minimize
    from etude.models.gp.plugin_kernel import PluginKernel
    from etude.models.gp.single_point import PointMean
    from etude.models.learned_model import LearnedModel
    from etude.models.members import member_named
    from etude.models.process import Posteriors, Silent, Teaching, restored, taught
    from etude.models.selection.linear import LinearPhysics, linear_inputs
    from etude.models.selection.model_selection import ModelSelection, read_residuals, select_structures
    from etude.models.store import load_model, save_model
    from etude.models.student_t import fit_student
    from etude.models.trust import trusted

__all__ = [
    "COUNT",
    "EVERY",
    "FIRST",
    "LARGEST_FLOOR",
    "NORMAL_95",
    "SENSOR",
    "TRANSIENT_S",
    "USUAL_COMMANDS",
    "BasisPosterior",
    "BayesianLinear",
    "Cause",
    "ChangeTest",
    "ExactGP",
    "ExactPosterior",
    "FixedInducing",
    "Folds",
    "Form",
    "InducingGP",
    "JitterWarning",
    "Kernel",
    "LearnedModel",
    "Linear",
    "LinearPhysics",
    "Load",
    "ModelConfig",
    "ModelSelection",
    "PluginKernel",
    "PointMean",
    "Posteriors",
    "Prior",
    "Silent",
    "SquaredExponential",
    "Structure",
    "Teaching",
    "about_origin",
    "apparent_loads",
    "ard_se",
    "block_masks",
    "change_test",
    "contiguous_blocks",
    "drift_onset",
    "factorise",
    "figures",
    "first_alarm",
    "fit",
    "fit_data",
    "fit_inducing",
    "fit_student",
    "fold_numbers",
    "followed",
    "in_order",
    "initial_gp",
    "initial_inducing",
    "kernel_metadata",
    "kernel_of",
    "linear_inputs",
    "load_forecast",
    "load_model",
    "load_of",
    "member_named",
    "minimize",
    "near_times",
    "posterior_arrays",
    "posterior_given",
    "posterior_metadata",
    "posterior_of",
    "prediction_score",
    "read_residuals",
    "restored",
    "rows_of",
    "save_model",
    "score_trajectories",
    "select_structures",
    "split_blocks",
    "structured",
    "taught",
    "trained_process",
    "trusted",
    "units_of",
    "while_any_moves",
    "whole_mass",
]
__getattr__, __dir__ = face(__name__)
