"""Where the knots of a smoothing spline lie: at points, more of them where the curve is far from them.

Source: P. Dierckx, "Curve and Surface Fitting with Splines" (1993), chapter 5.
"""

from __future__ import annotations

from typing import no_type_check

from yolino.compiled import compiled


@compiled
@no_type_check
def place_knots(at, degree, count, knots):
    """Writes the knots of a curve without inner ones, or of one that can pass through all points.

    The inner knots of the latter lie at points, but for the first and the last few; if the degree is even,
    halfway between points.

    Args:
        at: Parameters of the points.
        degree: Degree k of the curve.
        count: Number of its coefficients: k + 1, or as many as there are points.
        knots: Place for them.
    """
    for i in range(degree + 1):
        knots[i], knots[count + i] = at[0], at[-1]
    for i in range(count - degree - 1):
        left, right = i + (degree + 1) // 2, i + degree // 2 + 1
        knots[degree + 1 + i] = (at[left] + at[right]) / 2


@compiled(inline=True)
@no_type_check
def choose_number(last, excess, gain, near):
    """Gives how many knots to add, where the `last` added lowered the sum of squares by `gain`.

    As many as remove the `excess` over the bound if each goes on to gain as much, but at most twice and at
    least half as many as last. If the gain is below `near`, twice as many.
    """
    if last == 0:
        return 1
    wanted = 2 * last
    if gain > near:
        wanted = int(min(last * excess / gain, 2.0 * last))
    return max(wanted, last // 2, 1)


@compiled(inline=True)
@no_type_check
def sum_intervals(squares, spans, degree, sums):
    """Writes the sum of squares of the points in each interval; a point at a knot is half in either."""
    for i in range(len(squares)):
        sums[i] = 0.0
    for i in range(len(squares)):
        interval = spans[i] - degree
        if i > 0 and spans[i] != spans[i - 1]:
            sums[interval - 1] += squares[i] / 2
            sums[interval] += squares[i] / 2
        else:
            sums[interval] += squares[i]


@compiled(inline=True)
@no_type_check
def insert_knot(knots, count, at, intervals):
    """Adds a knot at the middle point of the interval with the largest sum of squares.

    Args:
        knots: Knots so far, all of them at points, and room for one more.
        count: Number of coefficients so far.
        at: Parameters of the points.
        intervals: How many points lie within each interval, without those at its knots, and its sum of
            squares. Without points it is not chosen. The two new ones share its sum by their points.
    """
    inside, sums = intervals
    degree, chosen, begin, first = len(knots) - len(at) - 1, -1, 0, 1
    for j in range(count - degree):
        if inside[j] > 0 and (chosen < 0 or sums[j] > sums[chosen]):
            chosen, begin = j, first
        first += inside[j] + 1
    for j in range(count - degree, chosen, -1):
        inside[j], sums[j] = inside[j - 1], sums[j - 1]
    for j in range(count + degree + 1, chosen + degree + 1, -1):
        knots[j] = knots[j - 1]
    points = inside[chosen]
    left = points // 2
    right = points - left - 1
    knots[chosen + degree + 1] = at[begin + left]
    inside[chosen], inside[chosen + 1] = left, right
    sums[chosen], sums[chosen + 1] = sums[chosen] * left / points, sums[chosen] * right / points
