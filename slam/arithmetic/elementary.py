"""Elementary functions of sums, products and quotients alone, whose bits do not depend on the processor.

A C library has several versions of each and chooses by the processor; they differ in the last bit. These are plain
functions of floats that call nothing but what IEEE 754 rounds exactly: interpreted and compiled they give the same
bits. After fdlibm (Sun Microsystems 1993), whose coefficients these are; within one unit in the last place.
"""

import math

FAR = 1e5  # rad; beyond, whole turns of the rounded 2 pi are taken off first, which is exact but not the same angle
QUARTERS = 0.63661977236758134308  # 2 / pi
HALF_PI_1, HALF_PI_2 = 1.57079632673412561417, 6.07710050630396597660e-11  # the first 33 bits, and the next
HALF_PI_REST = 2.02226624879595063154e-21
HALF_PI, HALF_PI_LOW = 1.57079632679489655800, 6.12323399573676603587e-17
LN_2, LN_2_LOW, PER_LN_2 = 6.93147180369123816490e-01, 1.90821492927058770002e-10, 1.44269504088896338700
LARGEST_EXPONENT, SMALLEST_EXPONENT = 709.782712893384, -745.1332191019411
LN_HALF_ROOT = 0.70710678118654752440


def squared(value: float) -> float:
    """Its square; the operator ** asks the C library's pow."""
    return value * value


def hypotenuse(x: float, y: float) -> float:
    """Length of (x, y), for lengths whose squares are numbers."""
    return math.sqrt(x * x + y * y)


def cosine_sine(angle: float) -> tuple[float, float]:
    """Cosine and sine; both NaN where the angle is no finite number."""
    if not abs(angle) < FAR:
        if not abs(angle) < math.inf:
            return math.nan, math.nan
        angle = angle % (2.0 * math.pi)
    quarter = math.floor(angle * QUARTERS + 0.5)
    turns = float(quarter)
    # the angle less whole quarters of a turn, as a sum of two numbers (Cody and Waite)
    rough = angle - turns * HALF_PI_1
    near = rough - turns * HALF_PI_2
    rest = turns * HALF_PI_REST - ((rough - near) - turns * HALF_PI_2)
    x = near - rest
    low = (near - x) - rest
    z = x * x
    tail = 8.33333333332248946124e-03 + z * (
        -1.98412698298579493134e-04
        + z * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10))
    )
    cube = z * x
    sine = x - ((z * (0.5 * low - cube * tail) - low) + cube * 1.66666666666666324348e-01)
    tail = z * (
        4.16666666666666019037e-02
        + z
        * (
            -1.38888888888741095749e-03
            + z
            * (
                2.48015872894767294178e-05
                + z * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11))
            )
        )
    )
    half = 0.5 * z
    whole = 1.0 - half
    cosine = whole + (((1.0 - whole) - half) + (z * tail - x * low))
    which = quarter & 3
    if which == 0:
        return cosine, sine
    if which == 1:
        return -sine, cosine
    if which == 2:
        return -cosine, -sine
    return sine, -cosine


def arctangent(y: float, x: float) -> float:
    """The angle in [-pi, pi] of the vector (x, y), with signs of zero and infinity as atan2 has them."""
    across, along = abs(y), abs(x)
    if across != across or along != along:
        return math.nan
    less, more = min(across, along), max(across, along)
    ratio = less / more if less < more else (0.0 if more == 0.0 else 1.0)
    if ratio < 0.4375:
        whole, low, t = 0.0, 0.0, ratio
    elif ratio < 0.6875:
        whole, low, t = 4.63647609000806093515e-01, 2.26987774529616870924e-17, (2.0 * ratio - 1.0) / (2.0 + ratio)
    else:
        whole, low, t = 7.85398163397448278999e-01, 3.06161699786838301793e-17, (ratio - 1.0) / (ratio + 1.0)
    z = t * t
    w = z * z
    odd = z * (
        3.33333333333329318027e-01
        + w
        * (
            1.42857142725034663711e-01
            + w
            * (
                9.09088713343650656196e-02
                + w * (6.66107313738753120669e-02 + w * (4.97687799461593236017e-02 + w * 1.62858201153657823623e-02))
            )
        )
    )
    even = w * (
        -1.99999999998764832476e-01
        + w
        * (
            -1.11111104054623557880e-01
            + w * (-7.69187620504482999495e-02 + w * (-5.83357013379057348645e-02 - w * 3.65315727442169155270e-02))
        )
    )
    angle = whole - ((t * (odd + even) - low) - t)
    if across > along:
        angle = HALF_PI - (math.copysign(angle, x) - HALF_PI_LOW)
    elif math.copysign(1.0, x) < 0.0:
        angle = 2.0 * HALF_PI - (angle - 2.0 * HALF_PI_LOW)
    return math.copysign(angle, y)


def exponential(x: float) -> float:
    """e to the power of x; infinite and 0 where it is too large and too small."""
    if x != x:
        return x
    if x > LARGEST_EXPONENT:
        return math.inf
    if x < SMALLEST_EXPONENT:
        return 0.0
    power = math.floor(x * PER_LN_2 + 0.5)
    high, low = x - power * LN_2, power * LN_2_LOW
    r = high - low
    t = r * r
    c = r - t * (
        1.66666666666666019037e-01
        + t
        * (
            -2.77777777770155933842e-03
            + t * (6.61375632143793436117e-05 + t * (-1.65339022054652515390e-06 + t * 4.13813679705723846039e-08))
        )
    )
    return math.ldexp(1.0 - ((low - (r * c) / (2.0 - c)) - high), power)


def logarithm(x: float) -> float:
    """The natural logarithm; -inf of 0 and NaN of what is less."""
    if not x > 0.0:
        return -math.inf if x == 0.0 else math.nan
    if x == math.inf:
        return x
    mantissa, power = math.frexp(x)
    if mantissa < LN_HALF_ROOT:
        mantissa, power = 2.0 * mantissa, power - 1
    f = mantissa - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01))
    odd = z * (
        6.666666666666735130e-01
        + w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    half = 0.5 * f * f
    return power * LN_2 - ((half - (s * (half + (even + odd)) + power * LN_2_LOW)) - f)
