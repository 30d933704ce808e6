"""Line charts as SVG, one below the other over a common time axis. Used by soak.py."""

import math
from dataclasses import dataclass
from html import escape

# Colours that people with any colour vision can tell apart (Okabe and Ito, 2008).
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
WIDTH, PANEL_HEIGHT = 900, 220
# Space around the area of a panel, for its title, its labels and its legend.
LEFT, RIGHT, TOP, BOTTOM = 64, 190, 40, 30
N_TICKS = 5


@dataclass
class Panel:
    """A chart of several curves in one unit. The legend gives the last value of each, since curves may coincide."""

    title: str
    curves: dict[str, list[tuple[float, float]]]
    """Points (time in s, value) by name."""


def draw(panels: list[Panel], end_s: float, marks_s: list[float]) -> str:
    """Returns the figure as SVG, with a thin vertical line at each of `marks_s`."""
    unit, divisor = ("h", 3600.0) if end_s > 2 * 3600 else ("min", 60.0)
    names = list(dict.fromkeys(name for panel in panels for name in panel.curves))
    colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(names)}
    height = len(panels) * PANEL_HEIGHT + 24
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" viewBox="0 0 {WIDTH} {height}" '
        'font-family="sans-serif" font-size="12" fill="#222">',
        f'<rect width="{WIDTH}" height="{height}" fill="#fff"/>',
    ]
    for i, panel in enumerate(panels):
        parts += _panel(panel, i * PANEL_HEIGHT, end_s, divisor, marks_s, colours)
    middle = (LEFT + WIDTH - RIGHT) / 2
    parts += [f'<text x="{middle}" y="{height - 8}" text-anchor="middle">time ({unit})</text>', "</svg>"]
    return "\n".join(parts) + "\n"


def _panel(panel, top, end_s, divisor, marks_s, colours) -> list[str]:
    bottom, right = top + PANEL_HEIGHT - BOTTOM, WIDTH - RIGHT
    highest = max((value for points in panel.curves.values() for _, value in points), default=1.0)
    step = _step(highest)
    limit = step * max(1, math.ceil(highest / step))

    def x(time_s):
        return LEFT + (right - LEFT) * time_s / end_s

    def y(value):
        return bottom - (bottom - top - TOP) * value / limit

    parts = [f'<text x="{LEFT}" y="{top + TOP - 14}" font-weight="bold">{escape(panel.title)}</text>']
    for i in range(round(limit / step) + 1):
        at = y(i * step)
        parts.append(f'<line x1="{LEFT}" x2="{right}" y1="{at:.1f}" y2="{at:.1f}" stroke="#ddd"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{at + 4:.1f}" text-anchor="end">{i * step:g}</text>')
    time_step = _step(end_s / divisor)
    for i in range(math.floor(end_s / divisor / time_step) + 1):
        at = x(i * time_step * divisor)
        parts.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{bottom}" y2="{bottom + 4}" stroke="#222"/>')
        parts.append(f'<text x="{at:.1f}" y="{bottom + 17}" text-anchor="middle">{i * time_step:g}</text>')
    for at in map(x, marks_s):
        parts.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{top + TOP}" y2="{bottom}" stroke="#bbb" stroke-width="0.7"/>')
    parts.append(f'<line x1="{LEFT}" x2="{right}" y1="{bottom}" y2="{bottom}" stroke="#222"/>')
    for i, (name, points) in enumerate(panel.curves.items()):
        text = " ".join(f"{x(time_s):.1f},{y(value):.1f}" for time_s, value in points)
        colour, at = colours[name], top + TOP + 8 + 17 * i
        parts.append(f'<polyline points="{text}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
        parts.append(f'<line x1="{right + 14}" x2="{right + 36}" y1="{at}" y2="{at}" stroke="{colour}" stroke-width="3"/>')
        last = f" {points[-1][1]:.4g}" if points else ""
        parts.append(f'<text x="{right + 42}" y="{at + 4}">{escape(name + last)}</text>')
    return parts


def _step(highest: float) -> float:
    """Returns the distance of about `N_TICKS` ticks from 0 to `highest`: 1, 2 or 5 times a power of ten."""
    raw = max(highest, 1e-9) / N_TICKS
    power = 10.0 ** math.floor(math.log10(raw))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= raw)
