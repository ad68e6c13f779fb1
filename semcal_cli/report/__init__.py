"""A calibration as one page that needs no network: verdict, numbers to copy, pictures, and how sure it is and why."""

from semcal_cli.report.page import write_report
from semcal_cli.report.subject import Subject, make_subject, read_subject

__all__ = ["Subject", "make_subject", "read_subject", "write_report"]
