"""The paper's figures, computed and set beside what is printed."""

from .figures import all_rows, report
from .pictures import draw_all
from .row import Row, table

__all__ = ["Row", "all_rows", "draw_all", "report", "table"]
