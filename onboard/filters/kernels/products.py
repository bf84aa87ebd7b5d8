"""Compiled sums of products, nine at a time: nine sums need six loads, one sum needs two."""

from onboard.compiled import CONTRACTED, FILLING, kernel


@kernel(**FILLING)
def padded(rows):
    """Return the number of rows, rounded up to a multiple of three."""
    return (rows + 2) // 3 * 3


@kernel(**FILLING, **CONTRACTED)
def squares_into(a, count, out):
    """Fill the lower triangle of out = a[:, :count] a[:, :count]^T.

    The number of rows must be a multiple of three.
    """
    for i in range(0, a.shape[0], 3):
        u, v, w = a[i, 0], a[i + 1, 0], a[i + 2, 0]
        uu, vu, vv, wu, wv, ww = u * u, v * u, v * v, w * u, w * v, w * w
        for s in range(1, count):
            u, v, w = a[i, s], a[i + 1, s], a[i + 2, s]
            uu += u * u
            vu += v * u
            vv += v * v
            wu += w * u
            wv += w * v
            ww += w * w
        out[i, i] = uu
        out[i + 1, i], out[i + 1, i + 1] = vu, vv
        out[i + 2, i], out[i + 2, i + 1], out[i + 2, i + 2] = wu, wv, ww
        for j in range(0, i, 3):
            u, v, w, x, y, z = a[i, 0], a[i + 1, 0], a[i + 2, 0], a[j, 0], a[j + 1, 0], a[j + 2, 0]
            ux, uy, uz, vx, vy, vz, wx, wy, wz = u * x, u * y, u * z, v * x, v * y, v * z, w * x, w * y, w * z
            for s in range(1, count):
                u, v, w = a[i, s], a[i + 1, s], a[i + 2, s]
                x, y, z = a[j, s], a[j + 1, s], a[j + 2, s]
                ux += u * x
                uy += u * y
                uz += u * z
                vx += v * x
                vy += v * y
                vz += v * z
                wx += w * x
                wy += w * y
                wz += w * z
            out[i, j], out[i, j + 1], out[i, j + 2] = ux, uy, uz
            out[i + 1, j], out[i + 1, j + 1], out[i + 1, j + 2] = vx, vy, vz
            out[i + 2, j], out[i + 2, j + 1], out[i + 2, j + 2] = wx, wy, wz


@kernel(**FILLING, **CONTRACTED)
def offsets_by_into(points, d, m, out):
    """Fill out (n, m) with the sum over points 1 to n of their offsets from the centre, times those of d.

    d is (padded(m), n).
    """
    n = points.shape[1]
    plus, whole = points[1 : n + 1], n // 3 * 3
    for i in range(0, whole, 3):
        p, q, r = points[0, i], points[0, i + 1], points[0, i + 2]
        for j in range(0, m, 3):
            ux, uy, uz, vx, vy, vz, wx, wy, wz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for s in range(n):
                u, v, w = plus[s, i] - p, plus[s, i + 1] - q, plus[s, i + 2] - r
                x, y, z = d[j, s], d[j + 1, s], d[j + 2, s]
                ux += u * x
                uy += u * y
                uz += u * z
                vx += v * x
                vy += v * y
                vz += v * z
                wx += w * x
                wy += w * y
                wz += w * z
            out[i, j], out[i, j + 1], out[i, j + 2] = ux, uy, uz
            out[i + 1, j], out[i + 1, j + 1], out[i + 1, j + 2] = vx, vy, vz
            out[i + 2, j], out[i + 2, j + 1], out[i + 2, j + 2] = wx, wy, wz
    for i in range(whole, n):
        for a in range(m):
            total = 0.0
            for s in range(n):
                total += (plus[s, i] - points[0, i]) * d[a, s]
            out[i, a] = total
