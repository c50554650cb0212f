"""The document of the loss of messages in recordings: independent, or in bursts."""

from __future__ import annotations

from dataclasses import asdict

import polars as pl

from vibroswarm.calibrate.message_loss import LEAST_GAIN, STEPS, LossFits
from vibroswarm.core.numbers import count, number, percent, plus_minus, stated
from vibroswarm.show.document import Column, Document, Table, Text


def message_loss_document(found: LossFits) -> Document:
    """Return whether robots lose messages in bursts: two models, and the gaps that they expect."""
    return Document(
        title="Losses of messages",
        answer=(_answer(found),),
        parts=(
            Text(
                f"{count(len(found.windows), 'receiver')}, {count(found.messages, 'message')} addressed to them. "
                "Intervals of more than twice the median between a robot's own samples hold "
                f"{percent(found.sent_in_long)} of the messages and {percent(found.lost_in_long)} of the lost ones."
            ),
            _models(found),
            _gaps(found),
        ),
        data=_data(found),
    )


def _answer(found: LossFits) -> str:
    """Say which model predicts better: the one with the smaller AIC, bursts only from ``LEAST_GAIN`` on."""
    gain, least = found.gain, stated(LEAST_GAIN)
    if gain <= 0:
        alike = found.models["independent"].aic <= found.aic_by_receiver
        how = "" if alike else ", with a share of its own for each receiver,"
        return f"No bursts found: independent losses{how} fit as well (AIC lower by {number(-gain, 1)})."
    if gain < LEAST_GAIN:
        return (
            f"Inconclusive: bursts fit better than independent losses, but by too little (AIC lower by "
            f"{number(gain, 1)}; {least} are needed)."
        )
    bursts = found.models["bursts"]
    return (
        f"Messages are lost in bursts (AIC lower by {number(gain, 1)} than with independent losses; {least} are "
        f"needed): bad periods of "
        f"{number(bursts.bad_s, 1)} s on average, {percent(bursts.bad_share)} of the time, in which "
        f"{percent(bursts.lost_in_bad)} of the messages are lost."
    )


def _models(found: LossFits) -> Table:
    """Return the fitted models, and the standard errors of the one with bursts if they were computed."""
    figures = ("lost", "bad_share", "bad_s", "lost_in_bad", "lost_in_good")
    rows = [
        {"model": name} | {figure: getattr(model, figure) for figure in (*figures, "log_likelihood", "aic")}
        for name, model in found.models.items()
    ]
    rows.insert(1, {"model": "independent, each receiver by itself", "aic": found.aic_by_receiver})
    if found.errors:
        rows.append({"model": "standard error of bursts", **found.errors})
    columns = {
        "lost": Column(share=True, decimals=2),
        "bad_share": Column(decimals=4),
        "bad_s": Column(decimals=1),
        "lost_in_bad": Column(decimals=3),
        "lost_in_good": Column(decimals=4),
        "log_likelihood": Column("log likelihood", decimals=1),
        "aic": Column("AIC", decimals=1),
    }
    caption = "Models, with the fields of the network `bursts`."
    return Table(pl.DataFrame(rows, infer_schema_length=None), columns, caption, "models")


def _gaps(found: LossFits) -> Table:
    """Return the recorded number of gaps of each size beside those that the models expect."""
    ends = [*(str(size - 1) for size in STEPS[1:]), "more"]
    rows = [
        {
            "messages": f"{size} or more"
            if end == "more"
            else str(size)
            if str(size) == end
            else f"{size} to {end}",
            "found": int(found.gaps[place]),
            **{
                name: plus_minus(float(mean[place]), float(deviation[place]), 1)
                for name, (mean, deviation) in found.expected.items()
            },
        }
        for place, (size, end) in enumerate(zip(STEPS, ends, strict=True))
    ]
    caption = "Gaps (messages lost in a row) by size, all receivers; expected ± standard deviation."
    return Table(pl.DataFrame(rows), {}, caption, "gaps")


def _data(found: LossFits) -> dict[str, pl.DataFrame]:
    fits = [{"model": name, **asdict(model), "aic": model.aic} for name, model in found.models.items()]
    expected = {f"expected_{name}": mean.tolist() for name, (mean, _) in found.expected.items()}
    return {
        "fits": pl.DataFrame(fits),
        "fits_by_receiver": pl.DataFrame(
            [
                {"run": one.run, "robot": one.robot, "lost": model.lost, "aic": model.aic}
                for one, model in zip(found.windows, found.by_receiver, strict=True)
            ]
        ),
        "standard_errors": pl.DataFrame([found.errors] if found.errors else []),
        "gaps": pl.DataFrame({"from": list(STEPS), "found": found.gaps.tolist(), **expected}),
        "long_intervals": pl.DataFrame({"lost": [found.lost_in_long], "sent": [found.sent_in_long]}),
    }
