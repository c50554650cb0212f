"""Inspection by place: where something vibrates, how sure that is, what would have been missed, when one may stop."""
