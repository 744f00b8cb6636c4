"""What somebody meets who uses exported C: odd inputs, odd names, refusals, a header, a loop."""

from __future__ import annotations

import locale
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c_library import FLAGS, Library, LibraryController
from c_models import (
    ARM,
    arm_model,
    arm_spec,
    averaged,
)

from compilers import FAST, STRICT, run, tool
from etude.deploy import CForm, c_files
from etude.deploy.targets.c99.plan import identifier, identifiers
from etude.deploy.targets.c99.self_test import expected_outputs, golden_vectors
from etude.deploy.targets.c99.source import numbers, prelude
from etude.deploy.targets.c99.target import C99, built, compiler, single_member
from etude.deploy.targets.ros2.target import ROS2
from etude.errors import EtudeError, UsageError
from etude.models import LearnedModel, PluginKernel, Posteriors, SquaredExponential, posterior_given
from etude.protocols import Candidate
from etude.types import Delivered

WHOLE = CForm(variance=True, digest="ab" * 32)
NOT_A_NUMBER, FAR, UNTRAINED, NO_ANSWER = 1, 2, 4, 16


def of(model: LearnedModel, form: CForm = WHOLE, name: str = "arm", spec: Any = None) -> Any:
    return c_files(model, ARM, spec or arm_spec(), form, name)


@pytest.fixture(scope="module")
def model() -> LearnedModel:
    return arm_model("exact", "standing", memory=True, physics=True, points=30)


@pytest.fixture(scope="module")
def fast(model: LearnedModel, tmp_path_factory: pytest.TempPathFactory) -> Library:
    """Built as it is on robots: with everything that a compiler may assume of numbers."""
    flags = ("-std=c99", "-O1", "-ffast-math", "-fPIC")
    return Library(of(model), tmp_path_factory.mktemp("fast"), flags)


def test_no_input_makes_a_command_that_is_no_number(fast: Library) -> None:
    rows = golden_vectors(fast.plan, 8).inputs
    clean = [fast.call("predict", row)[1] for row in rows]
    for bad in (np.nan, np.inf, -np.inf, -np.nan, 1e308, -1e308):
        for function in ("mean", "predict", "instant", "gravity"):
            fast.begin()
            for row in rows:
                spoilt = row.copy()
                spoilt[[0, -1]] = bad
                flags, command, _ = fast.call(function, spoilt)
                assert np.isfinite(command).all()
                assert (np.abs(command) <= fast.plan.most).all()
                expected = UNTRAINED | NO_ANSWER if np.isfinite(bad) else NOT_A_NUMBER
                assert flags & expected, (bad, function, flags)
    fast.begin()
    again = [fast.call("predict", row)[1] for row in rows]
    np.testing.assert_array_equal(clean, again)  # and nothing stays behind


def test_a_missing_number_is_the_last_good_one(fast: Library) -> None:
    row = golden_vectors(fast.plan, 30).inputs[5]
    held = row.copy()
    held[2] = np.nan
    fast.begin()
    fast.call("mean", row)
    told = fast.call("mean", row)
    fast.begin()
    fast.call("mean", row)
    flags, command, _ = fast.call("mean", held)
    np.testing.assert_array_equal(command, told[1])
    assert flags == told[0] | NOT_A_NUMBER


def test_far_outside_it_says_so_and_is_what_python_says(fast: Library) -> None:
    middle, half = 0.5 * (fast.plan.low + fast.plan.high), 0.5 * (fast.plan.high - fast.plan.low)
    both = UNTRAINED | FAR
    for beyond, expected in ((0.0, 0), (20.0, both), (1e6, both)):
        fast.begin()
        flags, command, _ = fast.call("mean", middle + beyond * half)
        assert flags & 7 == expected, beyond
        told = expected_outputs(fast.plan, (middle + beyond * half)[None])
        assert np.abs(command - told.mean[0]).max() <= 1e-9 * fast.plan.limit.max()


def test_without_fading_it_is_the_posterior_s_mean_and_flags_tell_ranges(
    model: LearnedModel, tmp_path: Path
) -> None:
    bare = Library(of(model, CForm(fade=False), "bare"), tmp_path)
    middle, width = 0.5 * (bare.plan.low + bare.plan.high), bare.plan.high - bare.plan.low
    for beyond, expected in ((0.49, 0), (0.6, UNTRAINED), (1.1, UNTRAINED | FAR)):
        bare.begin()
        row = middle + beyond * width
        flags, command, _ = bare.call("mean", row)
        assert flags & 7 == expected
        told = expected_outputs(bare.plan, row[None], fade=False).mean[0]
        assert np.abs(command - told).max() <= 1e-12 * bare.plan.limit.max()
    with pytest.raises(AttributeError, match="bare_predict"):
        bare.call("predict", middle)


def test_what_friction_remembers_is_begun_anew(fast: Library) -> None:
    rows = golden_vectors(fast.plan, 40, seed=3).inputs
    for row in rows:
        fast.call("mean", row)
    fast.begin()
    found = np.stack([fast.call("mean", row)[1] for row in rows])
    np.testing.assert_allclose(found, golden_vectors(fast.plan, 40, seed=3).mean, rtol=0, atol=1e-9 * 255.0)
    fast.begin()
    backwards = np.stack([fast.call("mean", row)[1] for row in rows[::-1]])[::-1]
    assert np.abs(backwards - found).max() > 1e-3  # the way there counts


def test_exponentials_and_circles_are_as_good_as_the_library_s(tmp_path: Path) -> None:
    (tmp_path / "t.c").write_text(
        "#include <math.h>\n#include <stdint.h>\n#include <stdio.h>\n#include <string.h>\n"
        "#define SINGLE 0\n#define VARIANCE 1\ntypedef double real;\n"
        f"{prelude('exponentials( cosines_sines( ')}\n"
        """
int main(void)
{
    double e[BLOCK], c[BLOCK], s[BLOCK], worst = 0.0, off = 0.0;
    int i, j;
    for (j = 0; j < 40000; ++j) {
        for (i = 0; i < BLOCK; ++i) {
            e[i] = -1e-3 * (j * 17 + i) * (i % 3 ? 1.0 : 1e-6);
            c[i] = (j - 20000) * 0.0137 + i;
        }
        for (i = 0; i < BLOCK; ++i)
            e[i] = e[i] < -700.0 ? -700.0 : e[i];
        {
            double x[BLOCK], p[BLOCK];
            memcpy(x, e, sizeof x);
            memcpy(p, c, sizeof p);
            exponentials(e, BLOCK);
            cosines_sines(c, s, BLOCK);
            for (i = 0; i < BLOCK; ++i) {
                worst = fmax(worst, fabs(e[i] / exp(x[i]) - 1.0));
                off = fmax(off, fmax(fabs(c[i] - cos(p[i])), fabs(s[i] - sin(p[i]))));
            }
        }
    }
    printf("%.3e %.3e", worst, off);
    return 0;
}
""",
        encoding="utf-8",
    )
    run([tool("gcc"), "-std=c99", "-O1", "t.c", "-lm", "-o", "t"], tmp_path)
    worst, off = map(float, run(["./t"], tmp_path).split())
    assert 0.0 < worst <= 1e-15
    assert off <= 1e-15


def test_numbers_read_back_exactly_in_any_locale(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.array([0.1, 1e300, -5e-324, 3.0, 1e22, np.pi, -0.0])
    before = numbers(values, False)
    assert [float(text) for text in before] == values.tolist()
    assert all("." in text or "e" in text for text in before)
    single = numbers(values[[0, 3, 5]], True)
    assert [np.float32(text.rstrip("f")) for text in single] == [np.float32(v) for v in values[[0, 3, 5]]]
    for name in ("de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8"):
        try:
            locale.setlocale(locale.LC_NUMERIC, name)
        except locale.Error:
            continue
        try:
            assert numbers(values, False) == before
        finally:
            locale.setlocale(locale.LC_NUMERIC, "C")


def test_names_that_c_does_not_take() -> None:
    odd = ["2nd joint", "a-b", "a b", "int", "Größe", "_x", "for", "A_B"]
    assert identifier("int") == "int_"
    found = identifiers(odd)
    assert found == ["n_2nd_joint", "a_b", "a_b_2", "int_", "Gr__e", "n_x", "for_", "A_B_3"]


def test_joints_with_odd_names_are_mangled_and_listed(tmp_path: Path) -> None:
    spec = arm_spec()
    names = "1st", "a*/b/*c", "int", "Größe"
    axes = tuple(replace(axis, name=name) for axis, name in zip(spec.axes, names, strict=True))
    odd = replace(spec, axes=axes)
    made = of(arm_model("exact", "ard_se", together=True, spec=odd), name="4dof-Arm", spec=odd)
    assert made.plan.name == "n_4dof_Arm"
    header = made.files["n_4dof_Arm.h"].decode()
    assert "N_4DOF_ARM_COMMAND_INT_ = 2" in header
    assert "(a* /b/ *c)" in header
    for file, data in made.files.items():
        (tmp_path / file).write_bytes(data)
    run([tool("gcc"), *STRICT, "-O0", "n_4dof_Arm.c", "n_4dof_Arm_test.c", "-lm", "-o", "t"], tmp_path)
    run(["./t"], tmp_path)
    said = C99(made.plan.model, ARM, odd, {"name": "x"}).notes
    assert any("'a*/b/*c' is a__b__c in C" in sentence for sentence in said)


class Foreign(SquaredExponential):
    """A kernel of somebody who wrote no C."""


def test_a_kernel_without_c_is_refused_by_name() -> None:
    model = arm_model("exact", "ard_se", points=12)
    own = model.candidates[0].process.own[0]  # type: ignore[union-attr]
    kernel = PluginKernel("my_kernels:waves", (), ("waist",), Foreign(own.kernel.dims))
    odd = posterior_given(kernel, own.theta, own.noise_variance, own.X, own.y)
    first = replace(model.candidates[0], process=Posteriors((odd,)))
    spoilt = replace(model, candidates=(first, *model.candidates[1:]))
    with pytest.raises(UsageError, match="kernel 'my_kernels:waves' cannot be exported to C"):
        of(spoilt)
    with pytest.raises(UsageError, match="a process of the form LocalPosterior cannot be exported"):
        of(arm_model("local_gp", "ard_se", points=12))


def test_float_is_refused_where_it_would_be_wrong() -> None:
    """Lengths far beyond the data, and no noise: weights of 1e5 that cancel to commands of 1."""
    tool("gcc")
    model = arm_model("exact", "ard_se", points=24)
    spoilt = []
    for candidate in model.candidates:
        own = candidate.process.own[0]  # type: ignore[union-attr]
        theta = own.theta + np.log(300.0) * (np.arange(len(own.theta)) > 0)
        sharp = posterior_given(own.kernel, theta, 1e-10, own.X, own.y)
        spoilt.append(replace(candidate, process=Posteriors((sharp,))))
    bad = replace(model, candidates=tuple(spoilt))
    with pytest.raises(UsageError, match=r"differ from Python's by up to \d.*of their limit"):
        C99(bad, ARM, arm_spec(), {"real": "float"})
    assert isinstance(C99(model, ARM, arm_spec(), {"real": "float"}), Delivered)


def test_options_that_a_target_does_not_know_are_refused(model: LearnedModel) -> None:
    with pytest.raises(UsageError, match="--to c has no option --set colour=VALUE") as error:
        C99(model, ARM, arm_spec(), {"colour": "red"})
    assert "--variance, --no-fade, --single, --rate" in error.value.next_step
    with pytest.raises(UsageError, match="double or float"):
        C99(model, ARM, arm_spec(), {"real": "half"})


def test_a_rate_that_nothing_keeps_is_refused_before_it_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("etude.deploy.targets.c99.target.built", lambda *_: pytest.fail("compiled"))
    both = averaged(arm_model("exact", "ard_se", points=24), arm_model("exact", "structured", points=24))
    with pytest.raises(UsageError, match="more than the 10 us at 100000 Hz") as error:
        C99(both, ARM, arm_spec(), {"rate": 100000.0})
    ways = error.value.next_step
    assert "--single uses only the best member" in ways
    assert "export without --rate" in ways
    with pytest.raises(UsageError, match="more than the 10 us") as alone:
        C99(both, ARM, arm_spec(), {"rate": 100000.0, "single": True})
    whole, single = (_us(one.value.fact) for one in (error, alone))
    assert float(ways.split("best member: about ")[1].split()[0]) == pytest.approx(single, rel=0.2)
    assert single < whole
    assert float(ways.split("--no-fade takes about ")[1].split()[0]) < whole
    monkeypatch.setattr("etude.deploy.targets.c99.target.built", lambda *_: None)
    assert not any(s.startswith("WARNING") for s in C99(both, ARM, arm_spec(), {"rate": 10.0}).notes)


def test_a_rate_that_only_the_best_candidates_keep_gets_them_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("etude.deploy.targets.c99.target.built", lambda *_: None)
    both = averaged(arm_model("exact", "ard_se", points=24), arm_model("exact", "structured", points=24))
    said = {one: C99(both, ARM, arm_spec(), {"single": one}).notes for one in (True, False)}
    alone, whole = (next(_us(s) for s in said[one] if "call takes" in s) for one in (True, False))
    assert alone < 0.7 * whole
    between = 1e6 / (0.5 * (alone + whole))
    found = C99(both, ARM, arm_spec(), {"rate": between})
    assert not any(s.startswith("WARNING") for s in found.notes)
    (why,) = (s for s in found.notes if "of each command is written" in s)
    assert float(why.split()[3]) == pytest.approx(whole, rel=0.2)
    assert found.files == C99(both, ARM, arm_spec(), {"rate": between, "single": True}).files
    (apart,) = (s for s in found.notes if s.startswith("etude predict averages the candidates."))
    assert any(float(word) > 0.0 for word in re.findall(r"(\S+) pwm", apart))
    # where no rate is named all of them are written, and where none keeps it the points that would are said
    assert found.files != C99(both, ARM, arm_spec(), {}).files
    with pytest.raises(UsageError) as error:
        C99(both, ARM, arm_spec(), {"rate": 4.0 * 1e6 / alone})
    assert int(error.value.next_step.split("1/")[1].split()[0]) >= 2


def _us(said: str) -> float:
    return float(said.split("call takes about ")[1].split()[0])


def test_the_time_of_a_call_is_told_where_no_rate_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("etude.deploy.targets.c99.target.built", lambda *_: None)
    model = arm_model("exact", "ard_se", points=24)
    assert any("of the time at 1000 Hz" in s for s in C99(model, ARM, arm_spec(), {}).notes)
    monkeypatch.setattr("etude.deploy.targets.c99.target.CLOCK", 1e6)
    assert any("more than the 1000 us at 1000 Hz" in s for s in C99(model, ARM, arm_spec(), {}).notes)


def test_the_best_candidate_alone_is_the_one_that_weighs_most() -> None:
    def weighing(*weights: float) -> Candidate:
        model = arm_model("exact", "ard_se", points=12, together=True)
        return replace(model.candidates[0], weights=np.array(weights))

    model = arm_model("exact", "ard_se", points=12, together=True)
    both = replace(model, candidates=(weighing(0.4, 0.6, 0.9, 0.1), weighing(0.6, 0.4, 0.1, 0.9)))
    found = [c.weights.tolist() for c in single_member(both).candidates]
    assert found == [[0.0, 1.0, 1.0, 0.0], [1.0, 0.0, 0.0, 1.0]]


def test_the_float_image_of_four_joints_fits(tmp_path: Path) -> None:
    """500 points of 12 inputs for each of four joints."""
    made = of(arm_model("exact", "structured", points=64), CForm(single=True, fade=False))
    per_point = made.tables / 64
    assert per_point * 512 <= 110 * 1024


USER = """\
#include "robot.h"
#include <stdio.h>

int main(void)
{
    robot_state state;
    robot_real input[ROBOT_INPUTS], command[ROBOT_COMMANDS], variance[ROBOT_COMMANDS];
    int i;
    robot_init(&state);
    while (1) {
        unsigned flags;
        for (i = 0; i < ROBOT_INPUTS; ++i)
            if (scanf("%lf", &input[i]) != 1)
                return 0;
        flags = robot_predict(&state, input, command, variance);
        printf("%u", flags);
        for (i = 0; i < ROBOT_COMMANDS; ++i)
            printf(" %.17g %.17g", command[i], variance[i]);
        robot_gravity(input, command);
        printf(" %.17g\\n", command[ROBOT_COMMAND_SHOULDER]);
    }
}
"""


def test_a_c_user_needs_the_header_alone(model: LearnedModel, tmp_path: Path) -> None:
    """A program written from robot.h: built by plain cc, and beside what the CMake file builds."""
    made = of(model, WHOLE, "robot")
    for file, data in made.files.items():
        (tmp_path / file).write_bytes(data)
    header = made.files["robot.h"].decode()
    # every name that the program takes stands in the header, as does the order of the inputs
    for name in set(re.findall(r"\brobot_\w+|\bROBOT_\w+", USER)):
        assert re.search(rf"\b{name}\b", header), name
    order = re.findall(r"^ +\d+ (\w+) +\S+ +\S+ \.\. ", header, re.MULTILINE)
    assert order[: len(made.plan.labels)] == made.plan.labels
    (tmp_path / "main.c").write_text(USER, encoding="utf-8")
    run([tool("cc"), "main.c", "robot.c", "-lm", "-o", "user"], tmp_path)
    vectors = golden_vectors(made.plan, 20, seed=5)
    text = "\n".join(" ".join(map(repr, row)) for row in vectors.inputs.tolist())
    (tmp_path / "states.txt").write_text(text, encoding="utf-8")
    said = run(["sh", "-c", "./user < states.txt"], tmp_path)
    found = np.array([line.split() for line in said.splitlines()], dtype=float)
    assert found[:, 0].astype(int).tolist() == vectors.flags.tolist()
    limit = made.plan.limit
    np.testing.assert_allclose(found[:, 1:9:2] / limit, vectors.mean / limit, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found[:, 2:9:2] / limit**2, vectors.variance / limit**2, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found[:, 9], vectors.gravity[:, 1], rtol=0, atol=1e-12 * limit[1])


@pytest.mark.slow
def test_the_cmake_file_builds_the_library_and_runs_its_test(model: LearnedModel, tmp_path: Path) -> None:
    for file, data in of(model, CForm(), "robot").files.items():
        (tmp_path / file).write_bytes(data)
    run([tool("cmake"), "-S", ".", "-B", "build"], tmp_path)
    run([tool("cmake"), "--build", "build"], tmp_path)
    said = run([tool("ctest"), "--test-dir", "build"], tmp_path)
    assert "100% tests passed" in said
    assert (tmp_path / "build" / "librobot.a").is_file()


@pytest.mark.slow
def test_in_the_loop_it_tracks_like_the_model(tmp_path: Path) -> None:
    """A model learned from the simulated arm, in the loop as C (-ffast-math) and as Python."""
    from etude import load_model
    from etude.campaign import create_campaign, simulate

    campaign, _ = create_campaign(tmp_path / "lab", "arm4", seed=1)
    list(simulate(campaign, rounds=1))
    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    learned = load_model(tmp_path / "lab")
    robot = kind.robot(spec, config)
    assert robot is not None
    library = Library(c_files(learned, kind, spec, WHOLE), tmp_path, (*FLAGS, *FAST))
    motion = kind.tests(spec, config, np.random.default_rng(3))
    (name, test), *_ = motion.items()
    errors = {}
    for who, controller in {
        "pd": None,
        "python": kind.controller(spec, config, learned),
        "c": LibraryController(library),
    }.items():
        log = robot.run(test, controller, np.random.default_rng(7))
        errors[who] = np.abs(robot.error(log)[0]).mean()
    assert errors["c"] == pytest.approx(errors["python"], rel=1e-3), name
    assert errors["c"] < 0.7 * errors["pd"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_refused(tmp_path: Path) -> None:
    from etude.errors import EtudeError
    from etude.storage import write_folder

    tmp_path.chmod(0o500)
    try:
        with pytest.raises(EtudeError, match="could not write"):
            write_folder(tmp_path / "out", {"a.h": b"x"}, "mark")
    finally:
        tmp_path.chmod(0o700)


def test_a_compiler_that_takes_too_long_is_told_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    if not compiler():
        pytest.skip("no C compiler on this machine")
    monkeypatch.setattr("etude.deploy.targets.c99.target.LONGEST_S", 1e-4)
    with pytest.raises(EtudeError, match="did not finish the exported model") as told:
        built("slow", {"slow.c": b"int one(void) { return 1; }\n"}, 0)
    assert "--single" in str(told.value.next_step)


@pytest.mark.parametrize("target", [C99, ROS2])
@pytest.mark.parametrize("rate", [0.0, -5.0, float("nan")])
def test_a_rate_that_is_not_above_zero_is_refused(target: Any, rate: float, model: LearnedModel) -> None:
    with pytest.raises(UsageError, match="a rate must be above 0 Hz"):
        target(model, ARM, arm_spec(), {"rate": rate})
