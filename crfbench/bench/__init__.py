"""What crfbench claims to be fast, as ratios to what one would take otherwise, measured side by side.

Each module measures one subject: `rows` gives its rows with settings that take seconds, and
``OPENBLAS_NUM_THREADS=1 python -m crfbench.bench.SUBJECT`` prints all that it can tell. `charts` and the accuracies of
`series` claim no speed.
"""
