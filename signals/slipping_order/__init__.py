"""Slipping orders: detection and tracking of a line whose order varies, as that of a bearing does."""
