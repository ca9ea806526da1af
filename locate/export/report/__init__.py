"""One HTML file that shows what a run found, and works without a network."""

from locate.export.report.page import ReportFrame, write_report

__all__ = ["ReportFrame", "write_report"]
