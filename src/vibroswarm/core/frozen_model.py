"""The base of all models that hold a user's settings."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, field_validator


class FrozenModel(BaseModel):
    """Frozen and strict: an unknown key, a wrong type, NaN and infinity are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True)

    @field_validator("*")
    @classmethod
    def _normalize_zero(cls, value: object) -> object:
        """Turn -0.0 into 0.0 (-0.0 + 0.0 is 0.0), also in tuples: equal values are written alike and have one hash."""
        if isinstance(value, tuple):
            return tuple(cls._normalize_zero(item) for item in value)
        return value + 0.0 if isinstance(value, float) else value
