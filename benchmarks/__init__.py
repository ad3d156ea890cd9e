"""What crfbench claims to be fast, as ratios to what one would take otherwise, measured side by side.

Each module measures one subject: `rows()` gives its rows, with settings that take seconds to minutes, and `growths()`,
where there is one, how the time grows. `accuracy` claims no speed. Run them with ``make bench`` or, one or some by
name, ``python -m benchmarks fitting slider``. The ratios are the claim; the seconds are of this machine and minute.
"""
