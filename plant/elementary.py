"""Sine, cosine, arctangent and exponential with the same bits on every machine.

The C library picks a variant of ``sin`` or ``exp`` by processor (with or without fused
multiply-add), and the variants differ in the last bit. A trace that must be the same bytes
everywhere cannot rest on that. The functions here use only +, −, ×, / and exact conversions, which
IEEE 754 defines to the bit; compiled without fast-math they give what the interpreter gives.

Method and coefficients are those of fdlibm (Sun Microsystems, 1993, freely usable with this
notice): Cody–Waite reduction by π/2 in parts of 33 bits, then minimax polynomials on [−π/4, π/4];
arctangent by one of four shifts and a polynomial of degree 21; exponential by reduction with ln 2
and a rational function. Errors stay below 1 unit in the last place (2 for the quotient in
``atan2``) for |x| < 8.2e5 rad.

Each function stands alone, so that ``compiled`` can take it as it is; the plain ones serve code
that has no need of Numba.
"""

import math

_TWO_OVER_PI = 6.36619772367581382433e-01
_PIO2_1 = 1.57079632673412561417e00  # first 33 bits of π/2
_PIO2_2 = 6.07710050630396597660e-11  # second 33 bits
_PIO2_2_TAIL = 2.02226624879595063154e-21  # π/2 minus both

_S1 = -1.66666666666666324348e-01
_S2 = 8.33333333332248946124e-03
_S3 = -1.98412698298579493134e-04
_S4 = 2.75573137070700676789e-06
_S5 = -2.50507602534068634195e-08
_S6 = 1.58969099521155010221e-10

_C1 = 4.16666666666666019037e-02
_C2 = -1.38888888888741095749e-03
_C3 = 2.48015872894767294178e-05
_C4 = -2.75573143513906633035e-07
_C5 = 2.08757232129817482790e-09
_C6 = -1.13596475577881948265e-11

_PI = 3.14159265358979311600e00
_PI_TAIL = 1.22464679914735317720e-16
_PIO2 = 1.57079632679489655800e00

_A0 = 3.33333333333329318027e-01
_A1 = -1.99999999998764832476e-01
_A2 = 1.42857142725034663711e-01
_A3 = -1.11111104054623557880e-01
_A4 = 9.09088713343650656196e-02
_A5 = -7.69187620504482999495e-02
_A6 = 6.66107313738753120669e-02
_A7 = -5.83357013379057348645e-02
_A8 = 4.97687799461593236017e-02
_A9 = -3.65315727442169155270e-02
_A10 = 1.62858201153657823623e-02

_LN2_HI = 6.93147180369123816490e-01
_LN2_LO = 1.90821492927058770002e-10
_LOG2_E = 1.44269504088896338700e00
_P1 = 1.66666666666666019037e-01
_P2 = -2.77777777770155933842e-03
_P3 = 6.61375632143793436117e-05
_P4 = -1.65339022054652515390e-06
_P5 = 4.13813679705723846039e-08


def sincos(x: float) -> tuple[float, float]:
    """Sine and cosine of ``x`` (rad), |x| < 8.2e5; one reduction serves both."""
    if -0.78 < x < 0.78:
        # what follows would give the same a, b and quadrant, later
        quadrant = 0
        a = x
        b = 0.0
    else:
        quadrant = math.floor(x * _TWO_OVER_PI + 0.5)
        turns = float(quadrant)
        # x − turns·π/2 as a sum a + b; the products with the 33-bit parts are exact
        first = x - turns * _PIO2_1
        w = turns * _PIO2_2
        second = first - w
        w = turns * _PIO2_2_TAIL - ((first - second) - w)
        a = second - w
        b = (second - a) - w

    # short chains of dependent operations: the processor works on several terms at a time
    z = a * a
    z2 = z * z
    cube = z * a
    tail = (_S2 + z * _S3) + z2 * ((_S4 + z * _S5) + z2 * _S6)
    sine = a - ((z * (0.5 * b - cube * tail) - b) - cube * _S1)

    half = 0.5 * z
    near_one = 1.0 - half
    tail = z * ((_C1 + z * _C2) + z2 * ((_C3 + z * _C4) + z2 * (_C5 + z * _C6)))
    cosine = near_one + (((1.0 - near_one) - half) + (z * tail - a * b))

    quadrant = quadrant & 3
    if quadrant == 0:
        return sine, cosine
    if quadrant == 1:
        return cosine, -sine
    if quadrant == 2:
        return -sine, -cosine
    return -cosine, sine


def atan2(y: float, x: float) -> float:
    """Angle of the point (x, y) in rad, in [−π, π]; zero for the origin."""
    if y == 0.0 and x >= 0.0:
        return y
    ay = abs(y)
    ax = abs(x)
    if ax == 0.0:
        return _PIO2 if y > 0.0 else -_PIO2
    t = ay / ax
    if t < 0.4375:
        high = 0.0
        low = 0.0
    elif t < 0.6875:
        high = 4.63647609000806093515e-01  # atan 0.5
        low = 2.26987774529616870924e-17
        t = (2.0 * t - 1.0) / (2.0 + t)
    elif t < 1.1875:
        high = 7.85398163397448278999e-01  # atan 1
        low = 3.06161699786838301793e-17
        t = (t - 1.0) / (t + 1.0)
    elif t < 2.4375:
        high = 9.82793723247329054082e-01  # atan 1.5
        low = 1.39033110312309984516e-17
        t = (t - 1.5) / (1.0 + 1.5 * t)
    else:
        high = _PIO2
        low = 6.12323399573676603587e-17
        t = -1.0 / t if t < 1e300 else 0.0
    z = t * t
    w = z * z
    w2 = w * w
    odd = z * ((_A0 + w * _A2) + w2 * ((_A4 + w * _A6) + w2 * (_A8 + w * _A10)))
    even = w * ((_A1 + w * _A3) + w2 * ((_A5 + w * _A7) + w2 * _A9))
    angle = high - ((t * (odd + even) - low) - t)
    if x < 0.0:
        angle = _PI - (angle - _PI_TAIL)
    return angle if y >= 0.0 else -angle


def exp(x: float) -> float:
    """Exponential of ``x``; zero below −745, where the result has no normal form left."""
    if x < -745.0:
        return 0.0
    if x > 709.0:
        return math.inf
    k = math.floor(x * _LOG2_E + 0.5)
    high = x - float(k) * _LN2_HI
    low = float(k) * _LN2_LO
    r = high - low
    t = r * r
    c = r - t * (_P1 + t * (_P2 + t * (_P3 + t * (_P4 + t * _P5))))
    y = 1.0 - ((low - (r * c) / (2.0 - c)) - high)
    return math.ldexp(y, k)
