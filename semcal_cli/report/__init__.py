"""A calibration as one page that works offline: verdict, transform to copy, images, and uncertainty."""

from semcal_cli.report.input import ReportInput, make_report_input, read_report_input
from semcal_cli.report.page import write_report

__all__ = ["ReportInput", "make_report_input", "read_report_input", "write_report"]
