"""De Vivo, Brandl, Battipede and Gili: square-root filters for sense and avoid.

`study` runs it.
"""
