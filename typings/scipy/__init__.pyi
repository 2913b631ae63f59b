# Types of what this project uses of SciPy, which has none of its own: a type checker would read
# its whole source instead, a quarter of `make types`. Another use of SciPy needs its line here.
