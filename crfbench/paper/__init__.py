"""The paper's room: what it prints, what we get, and why.

A claim of the paper stands in `claims` or `claims_data`, the numbers of its tables in `verdicts`, our tables in the
module of their subject, and what took minutes to compute in ``data/recorded``.
"""

from crfbench.lazy import found_when_used

# Names are found when first used: a table loads no figures, and nothing but the report loads widgets.
_NAMES = {
    "datasets.middlebury": "patch_intensity",
    "paper.calibration": "calibration_table camera_rmse_table chart_free_table",
    "paper.claims": "claims_table verdict_counts",
    "paper.figures": "calibration_figure comparison_figure patch_counts_figure plot_camera_rmse plot_coverage "
    "plot_fitting plot_validity stability_figure write_figures",
    "paper.findings": "claims_by_verdict does_not_follow holds paper_map summary",
    "paper.fitting": "display_table fitting_table fitting_tables papers_rising_rows",
    "paper.report": "latent_slider sortable_leaderboard write_report",
    "paper.results": "latent_table leaderboard load_recorded load_results",
    "paper.stability": "stability_table",
    "paper.verdicts": "CALIBRATION FITTING RULES STABILITY",
}

__all__ = sorted(" ".join(_NAMES.values()).split())  # noqa: PLE0605  a list, though not a literal one


__getattr__ = found_when_used(__name__, _NAMES)


def __dir__() -> list[str]:
    return __all__
