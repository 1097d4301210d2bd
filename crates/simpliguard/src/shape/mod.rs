//! Collapse to a face budget.
