"""One HTML file that shows what a run found, and works without a network."""

from locate.export.report.gallery import ReportFrame
from locate.export.report.page import write_report
from locate.export.report.scene import ColouredPoints

__all__ = ["ColouredPoints", "ReportFrame", "write_report"]
