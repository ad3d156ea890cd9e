"""Tidy tables: models x data x metrics, the paper's figure beside ours."""
