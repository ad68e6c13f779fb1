"""A calibration as one page that needs no network: verdict, numbers to copy, images, and how sure it is and why."""

from semcal_cli.report.input import ReportInput, make_report_input, read_report_input
from semcal_cli.report.page import write_report

__all__ = ["ReportInput", "make_report_input", "read_report_input", "write_report"]
