"""The SVG writer: values land where the axes say, ticks are round, thinning keeps extremes."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_campaign import decode_png, write_campaign

from etude.errors import UsageError
from etude.report import Axis, Line, Scale, element, fitted_scale, number, panel, table, thinned, tick_text
from etude.report.markup import duration, with_unit
from etude.report.pictures import main, write_picture
from etude.report.png import STOPS, colours, png_address
from etude.report.scales import linear_ticks, log_ticks
from etude.report.svg import Area, Band, Image, Level, Points

finite = st.floats(-1e6, 1e6, allow_nan=False)


@given(finite, st.floats(1e-3, 1e6))
def test_linear_ticks_are_round_inside_and_few(low: float, width: float) -> None:
    ticks = linear_ticks(low, low + width)
    assert 1 <= len(ticks) <= 11
    assert all(low - 1e-6 * width <= tick <= low + width * (1 + 1e-6) for tick in ticks)
    if len(ticks) > 1:
        mantissa = f"{ticks[1] - ticks[0]:.6e}"[0]
        assert mantissa in "125" or f"{ticks[1] - ticks[0]:.3e}".startswith(
            ("9.9", "1.0", "2.0", "5.0", "4.9", "1.9")
        )


@given(st.floats(1e-5, 1e3), st.floats(1.5, 1e4))
def test_log_ticks_lie_inside(low: float, ratio: float) -> None:
    assert all(low <= tick <= low * ratio for tick in log_ticks(low, low * ratio))


@pytest.mark.parametrize(("log", "middle"), [(False, 50.5), (True, 10.0)])
def test_a_scale_maps_its_ends_and_its_middle(log: bool, middle: float) -> None:
    scale = Scale(1.0, 100.0, 20.0, 220.0, log)
    np.testing.assert_allclose(scale([1.0, middle, 100.0]), [20.0, 120.0, 220.0])


@given(st.floats(0.0, 10.0), st.floats(0.5, 10.0))
def test_a_scale_of_numbers_of_logs_has_whole_ticks(low: float, width: float) -> None:
    for axis in (Axis("log", limits=(low, low + width), whole=True), Axis("log", whole=True)):
        scale = fitted_scale(axis, np.array([low, low + width]), 0.0, 100.0)
        assert all(tick == round(tick) for tick in scale.ticks())


def test_a_fitted_scale_holds_what_it_is_fitted_to() -> None:
    values = np.array([0.3, np.nan, 7.0])
    linear, log = (fitted_scale(Axis("x", log=kind), values, 0.0, 100.0) for kind in (False, True))
    for scale in (linear, log):
        assert scale.low < 0.3
        assert scale.high > 7.0
    assert fitted_scale(Axis("x", floor=0.0), values, 0.0, 1.0).low == 0.0
    assert np.isfinite(fitted_scale(Axis("x"), np.empty(0), 0.0, 1.0).high)
    assert fitted_scale(Axis("x"), np.array([2.0, 2.0]), 0.0, 1.0).high > 2.0


def test_a_drawn_point_can_be_read_back_from_the_panels_scale() -> None:
    marks = [Points(np.array([3.0]), np.array([0.2]), "p")]
    drawing = panel("t", Axis("x", limits=(0.0, 10.0)), Axis("y", log=True, limits=(0.1, 10.0)), marks)
    svg = ElementTree.fromstring(drawing)
    xl, xh, xs, xe, yl, yh, ys, ye, xlog, ylog = map(float, svg.attrib["data-scale"].split())
    circle = next(c for c in svg.iter("circle") if c.find("title") is not None)
    px, py = float(circle.attrib["cx"]), float(circle.attrib["cy"])
    assert (xlog, ylog) == (0.0, 1.0)
    assert xl + (px - xs) / (xe - xs) * (xh - xl) == pytest.approx(3.0, abs=0.01)
    assert yl * (yh / yl) ** ((py - ys) / (ye - ys)) == pytest.approx(0.2, rel=0.01)


def test_a_panel_is_well_formed_and_names_everything() -> None:
    x = np.linspace(0.0, 1.0, 5)
    marks = [
        Band(0.2, 0.4, "band <1>"),
        Level(0.5, "level"),
        Line(x, np.where(x > 0.6, np.nan, x), "broken & line"),
        Area(x, x - 0.1, x, x + 0.1, "area"),
        Image(png_address(np.zeros((2, 2, 3), np.uint8)), 0.0, 1.0, 0.0, 1.0),
    ]
    for end_labels in (False, True):
        svg = ElementTree.fromstring(
            panel("a < b", Axis("time (s)"), Axis("y (rad)"), marks, end_labels=end_labels)
        )
        words = [element.text for element in svg.iter("text")]
        for word in ("a < b", "time (s)", "y (rad)", "band <1>", "level", "area", "broken & line"):
            assert word in words


def test_nan_breaks_a_line() -> None:
    y = np.array([0.0, 1.0, np.nan, 1.0, 0.0])
    drawing = panel("", Axis("x"), Axis("y"), [Line(np.arange(5.0), y, style="broken")])
    path = re.search(r'class="line broken" d="([^"]*)"', drawing)
    assert path is not None
    assert path[1].count("M") == 2
    assert "nan" not in drawing


@given(st.integers(0, 3000), st.integers(0, 2**32 - 1))
def test_thinning_keeps_ends_extremes_and_order(n: int, seed: int) -> None:
    x, y = np.arange(n, dtype=float), np.random.default_rng(seed).standard_normal(n)
    tx, ty = thinned(x, y, points=100)
    assert len(tx) <= max(103, 0)
    if n:
        assert (ty.min(), ty.max()) == (y.min(), y.max())
        assert (tx[0], tx[-1]) == (x[0], x[-1])
        assert np.all(np.diff(tx) > 0)
        assert np.array_equal(ty, y[tx.astype(int)])


def test_the_png_decodes_to_the_pixels_that_went_in() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (3, 4, 3)).astype(np.uint8)
    assert np.array_equal(decode_png(png_address(pixels).split(",")[1]), pixels)


def test_the_colour_map_gets_brighter_all_the_way_and_clips() -> None:
    shades = colours(np.linspace(0.0, 1.0, 100)).astype(float) @ [0.2126, 0.7152, 0.0722]
    assert np.all(np.diff(shades) >= -0.5)
    assert np.array_equal(colours(np.array([-1.0, 2.0])), STOPS[[0, -1]].astype(np.uint8))


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.1314, "0.131"),
        (3.2, "3.20"),
        (-12.34, "−12.3"),
        (12345.6, "12,346"),
        (0.0, "0"),
        (float("nan"), "–"),
    ],
)
def test_numbers_have_three_digits_and_no_exponent(value: float, expected: str) -> None:
    assert number(value) == expected


def test_small_words() -> None:
    assert with_unit(0.1, "deg") == "0.100°"
    assert with_unit(0.1, "V", 2) == "0.10 V"
    assert with_unit(0.1, "1") == "0.100"
    assert duration(95.0) == "95 s"
    assert duration(245.0) == "4 min 5 s"
    assert duration(240.0) == "4 min"
    assert tick_text(-0.5) == "−0.5"
    assert tick_text(1e-13) == "0"
    assert element("a", "<", href='"') == '<a href="&quot;">&lt;</a>'
    assert table(["h"], [["<b>"]]).count("<b>") == 0


def test_the_picture_stands_alone(tmp_path: Path) -> None:
    write_campaign(tmp_path / "lab", rounds=2)
    path = write_picture(tmp_path / "lab", tmp_path / "picture.svg")
    svg = ElementTree.parse(path).getroot()
    assert svg.tag == "{http://www.w3.org/2000/svg}svg"
    words = [element.text for element in svg.iter("{http://www.w3.org/2000/svg}text")]
    assert words.count("learned by Étude") == 2
    main([str(tmp_path / "lab"), str(tmp_path / "again.svg")])
    assert (tmp_path / "again.svg").read_bytes() == path.read_bytes()


def test_there_is_no_picture_without_an_evaluation(tmp_path: Path) -> None:
    write_campaign(tmp_path, rounds=1, evaluated=False)
    with pytest.raises(UsageError, match="no evaluation to draw"):
        write_picture(tmp_path, tmp_path / "picture.svg")
    with pytest.raises(UsageError, match="two arguments"):
        main([])
