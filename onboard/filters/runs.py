"""A filter over a whole record: a loop of `predict` and `update`, with missing measurements.

    model = Model(lambda rows: rows @ F.T, Q, lambda rows: np.arctan2(rows[:, 1:2], rows[:, :1]), R, angular=(0,))
    found = run("unscented", model, Belief(mean, covariance), ys)        # mean (n,), ys (T, m)
    found.beliefs.mean, found.log_likelihood.sum()                       # (T, n), a number
    smooth(found)                                                        # of smoothers.py

- The first belief is that of the first measurement's time, before that measurement (as in pykalman, statsmodels,
  and Durbin & Koopman): y[0] updates it, and a prediction leads from each measurement to the next.
- Missing values are NaN, or masked in a masked array: a component, or a whole measurement. In a batch (mean (B,
  n), ys (T, B, m)) each member has its own. `None` in a list is a time without measurement, too.
- If a state's angle becomes too wide for a filter's points, after long without measurements, `turns` makes the
  steps until it is narrow again, and `wide` marks these. The filter then continues from that belief, as at a
  start.
- A filter of a batch that fails after the first measurement, by a belief too wide for a measured angle or
  without a factor, is left out: its beliefs are NaN from there on, `lost` says why, and the others continue. If
  none is left an error is raised, whose `found` is the run up to there.
- A model that changes is a function of the `Step`, which returns that step's Model: inputs, times between
  measurements, changing sensors, and so measurements of varying size, in a list. Late measurements are put in
  the order of `ts` first: `order = np.argsort(ts, kind="stable")`.
- `LinearModel` with method "kalman" runs in one compiled loop, many times as fast as any other.
"""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters import extended, turns
from onboard.filters.belief import Belief, FilterError, Method, NotPositiveDefiniteError, Rows, Update, mask
from onboard.filters.belief import start as checked
from onboard.filters.errors import SpreadError
from onboard.filters.families import method as method_of
from onboard.filters.state_space import AnyModel, LinearModel, Model, model_at, seconds

LOG_TWO_PI: Final = float(np.log(2 * np.pi))


class Lost(NamedTuple):
    """A filter of a batch that failed: its index, the measurement, and the error."""

    member: int
    k: int
    error: FilterError


class Run(NamedTuple):
    """A filter over T measurements, of one filter or of a batch (..., of B).

    Values of a missing measurement are NaN, its NIS and log-likelihood are zero; measurements of varying size are
    filled with NaN up to the largest. Values of a `lost` filter of a batch are NaN, from the measurement where it
    failed; its NIS is zero, of no degrees of freedom, and its state is another's.

    Attributes
    ----------
    predictions, beliefs
        Before and after each update: mean (T, ..., n) and covariance (T, ..., n, n).
    innovation : (T, ..., m)
        Innovations.
    innovation_covariance : (T, ..., m, m)
        Their covariances.
    predicted : (T, ..., m)
        Predicted measurements.
    nis, degrees : (T, ...)
        NIS and its degrees of freedom.
    log_likelihood : (T, ...)
        Log-likelihood of each measurement, given all before it.
    states
        The filter's own states after each update.
    method, model, ts
        The arguments of the run.
    wide : (T, ...)
        Steps that `turns` made.
    lost
        Filters that failed.
    """

    predictions: Belief
    beliefs: Belief
    innovation: Array
    innovation_covariance: Array
    predicted: Array
    nis: Array
    degrees: Array
    log_likelihood: Array
    states: tuple[Any, ...]
    method: Method
    model: AnyModel
    ts: Array
    wide: Array
    lost: tuple[Lost, ...] = ()

    def at(self, k: int) -> Model:
        """Return the model of step k."""
        return model_at(self.model, self.ts, k)

    @property
    def angular_states(self) -> tuple[int, ...]:
        """Indices of the states that are angles."""
        return self.at(len(self.ts) - 1).angular_states


def run(method: str | Method, model: AnyModel, start: Belief, ys: Any, ts: Any = None) -> Run:
    """Run a filter over the measurements of a record.

    Parameters
    ----------
    method
        A filter, or its name.
    model
        A `Model`, a `LinearModel`, or a function of the `Step` that returns a `Model`.
    start
        Belief at the time of the first measurement, before that measurement; one or a batch.
    ys : (T, m) or (T, B, m)
        Measurements.
    ts : (T,)
        Times that do not decrease; by default 0, 1, ... If a time repeats, nothing is predicted.

    Raises
    ------
    FilterError, NotPositiveDefiniteError
        The message begins with the measurement that failed, and `found` is the run up to there.
    """
    chosen = method_of(method) if isinstance(method, str) else method
    checked(*start)
    seen = _measurements(ys, start)
    times = _times(ts, len(seen))
    if isinstance(model, LinearModel):
        model = _fitted(model, start, seen, times)
        if chosen.name == "kalman":
            return _compiled(chosen, model, start, seen, times)
    return _stepped(chosen, model, start, seen, times)


def log_likelihood(update: Any) -> Any:
    """Return the log-likelihood of an update's measurement, a number or (...,).

    It is the density of the innovation; a mixture or a cloud of particles has its own.
    """
    own = getattr(update, "log_evidence", None)
    value = _gaussian(update.nis, update.innovation_covariance) if own is None else own
    return value if np.ndim(value) else float(value)


def _gaussian(nis: Any, S: Array) -> Array:
    """Return the log-density of innovations by their NIS (...,) and covariance S (..., m, m).

    NaN in S means not measured.
    """
    known = ~np.isnan(np.diagonal(S, axis1=-2, axis2=-1))
    filled = np.where(np.isnan(S), np.eye(S.shape[-1]), S)
    return np.asarray(-0.5 * (nis + np.linalg.slogdet(filled)[1] + known.sum(axis=-1) * LOG_TWO_PI))


def _updated(method: Method, state: Any, y: Array, model: Model) -> Any:
    """Update by the components of y (..., m) that are not missing.

    A missing component is replaced by one without information: a measurement of zero, with noise of one, that is
    zero for every state. That is exact for every filter, in a batch whose members lack others, and in a cloud.
    """
    missing = np.isnan(y)
    if not missing.any():
        return method.update(state, y, model.measure, model.R, model.angular, model.angular_states)
    if missing.all():
        nothing = np.full(y.shape, np.nan)
        return Update(state, nothing, nothing[..., None] * nothing[..., None, :], nothing, np.zeros(y.shape[:-1]))
    if "partial" in method.exempt:
        raise FilterError(f"y: {method.name} takes no partial measurement: {method.exempt['partial']}")
    measure = model.measure
    several = isinstance(measure, tuple)
    blank: Any = tuple(_blank(one, missing) for one in measure) if several else _blank(measure, missing)
    gone = missing[..., :, None] | missing[..., None, :]
    R = np.where(gone, np.eye(y.shape[-1]), model.R)
    filled = np.where(missing, 0.0, y)
    found = method.update(state, filled, blank, R, model.angular, model.angular_states)
    nan, own = np.nan, getattr(found, "log_evidence", None)
    return Update(
        _kept(state, found.belief, missing.all(axis=-1)) if missing.ndim > 1 else found.belief,
        np.where(missing, nan, found.innovation),
        np.where(gone, nan, found.innovation_covariance),
        np.where(missing, nan, found.predicted),
        found.nis,
        log_evidence=own if own is None else own + 0.5 * LOG_TWO_PI * np.sum(missing, axis=-1),
    )


def _with_jacobians(method: Method, model: Model, missing: Array) -> Method:
    """Return the extended filter with the model's Jacobians, if any.

    They are zero where y (..., m) is missing.
    """
    if method.name != "extended" or (model.process_jacobian is None and model.measure_jacobian is None):
        return method
    of_y = model.measure_jacobian
    if of_y is not None and missing.any():
        of_y = _blank(of_y, missing[..., None])
    return extended.method(model.process_jacobian, of_y)


def _kept(before: Any, after: Any, gone: Any) -> Any:
    """Return a state of a batch, unchanged where nothing was measured (B,).

    A filter that counts its updates does not count those.
    """

    def kept(a: Any, b: Array) -> Array:
        return np.where(gone.reshape(-1, *(1,) * (b.ndim - 1)), a, b) if np.shape(a) == b.shape else b

    return _each_array(kept, before, after)


def _each_array(change: Callable[..., Array], *states: Any) -> Any:
    """Return a state with `change` applied to each of its arrays.

    `change` also gets the arrays at the same place in the earlier states.
    """
    last = states[-1]
    if isinstance(last, tuple) and all(len(state) == len(last) for state in states):
        each = [_each_array(change, *parts) for parts in zip(*states, strict=True)]
        return type(last)(*each) if hasattr(last, "_fields") else tuple(each)
    return change(*states) if isinstance(last, np.ndarray) else last


def _blank(measure: Rows, missing: Array) -> Rows:
    """Return a measurement function with zero in place of the missing components.

    They are (m,), or (B, m) of each filter; of its Jacobian, (m, 1) or (B, m, 1).
    """

    def blank(rows: Array) -> Array:
        images = measure(rows)
        if missing.ndim == images.ndim - 1:
            return np.where(missing, 0.0, images)
        each = images.reshape(len(missing), -1, *images.shape[1:])
        return np.where(missing[:, None], 0.0, each).reshape(images.shape)

    return blank


def _stepped(method: Method, model: AnyModel, start: Belief, ys: list[Array], ts: Array) -> Run:
    """Run any filter, step by step."""
    state, made, losses = method.start(*start), [], _LostFilters(start)
    for k, y in enumerate(ys):
        losses.aside = []
        while True:
            try:
                step, moves = model_at(model, ts, k), bool(k and ts[k] > ts[k - 1])
                made.append(_advanced(method, state, y, step, moves, losses))
                break
            except FilterError as error:
                if k and losses.can_put_aside(error, method.belief(state), step):
                    continue
                if not losses.take(error, k):
                    before = losses.blanked(_collected(made, method, model, ts[:k])) if k else None
                    raise _placed(error, k, ts, before) from error
        state = made[-1].update.belief
    return losses.blanked(_collected(made, method, model, ts))


class _Outcome(NamedTuple):
    """One step: beliefs before and after the update, and the update.

    `wide` (...,) tells which filters `turns` advanced.
    """

    prediction: Belief
    belief: Belief
    update: Update
    wide: Any


def _step(method: Method, state: Any, y: Array, step: Model, moves: bool) -> _Outcome:
    own, ahead = _with_jacobians(method, step, np.isnan(y)), state
    if moves:
        ahead = own.predict(state, step.process, step.Q, step.angular_states)
    found = _updated(own, ahead, y, step)
    return _Outcome(method.belief(ahead), method.belief(found.belief), found, np.zeros(y.shape[:-1], bool))


def _advanced(method: Method, state: Any, y: Array, step: Model, moves: bool, losses: "_LostFilters") -> _Outcome:
    """Advance a filter, or a batch, by one step; those put aside by `turns` one by one."""
    found, parts, before = None, {}, method.belief(state)
    at: Any = None
    try:
        if losses.has_active:
            found = _step(method, losses.replaced(state), losses.replaced(y), step, moves)
        for at in losses.aside:
            parts[at] = _step(turns.METHOD, Belief(before.mean[at], before.covariance[at]), y[at], step, moves)
    except FilterError as error:
        if error.member:  # who stands there
            error.member = (int(losses.rows[error.member[0]]),)
        elif at is not None and at is not ...:
            error.member = (at,)
        raise
    if found is not None and not parts:
        return found
    whole = parts[...]._replace(wide=np.True_) if ... in parts else _merged(found, parts, losses.rows)
    restarted = method.start(*whole.belief)
    if found is not None:
        restarted = _kept(restarted, found.update.belief, whole.wide)
    return whole._replace(update=whole.update._replace(belief=restarted))


def _merged(found: _Outcome | None, parts: dict[Any, _Outcome], rows: Array) -> _Outcome:
    """Merge a batch's step from that of the others and of each that was put aside.

    `found` is None if there are no others.
    """

    def arrays(made: _Outcome) -> tuple[Any, ...]:
        return (*made.prediction, *made.belief, *made.update[1:4], made.update.nis)

    wide, log_evidence = np.isin(rows, list(parts)), None
    if found is None:
        each = [np.stack(column) for column in zip(*(arrays(parts[row]) for row in rows), strict=True)]
    else:
        each = [np.array(column) for column in arrays(found)]
        for b, part in parts.items():
            wide[b] = True
            for column, value in zip(each, arrays(part), strict=True):
                column[b] = value
        if found.update.log_evidence is not None:
            log_evidence = np.array(found.update.log_evidence)
            log_evidence[list(parts)] = [log_likelihood(part.update) for part in parts.values()]
    innovation, S, predicted, nis = each[4:]
    update = Update(None, innovation, S, predicted, nis, log_evidence=log_evidence)
    return _Outcome(Belief(*each[:2]), Belief(*each[2:4]), update, wide)


class _LostFilters:
    """The filters of a batch that failed, and those put `aside` for a step.

    The first of the others stands in for them, so that the batch keeps its size; its values for them are blanked
    at the end, or replaced. If a stand-in fails, it has failed itself.
    """

    def __init__(self, start: Belief) -> None:
        self._members = len(start.mean) if start.mean.ndim == 2 else 0
        self._left = [*range(self._members)]
        self._lost: list[Lost] = []
        self.aside: list[Any] = []

    def can_put_aside(self, error: FilterError, before: Belief, step: Model) -> bool:
        """Return whether `turns` must make this step of the filter that failed.

        That is if an angle of its state is too wide for its points, of one model.
        """
        at = error.member[0] if error.member else ...
        if not isinstance(error, SpreadError) or at in self.aside or isinstance(step.process, tuple):
            return False
        own = Belief(before.mean[at], before.covariance[at])
        if own.mean.ndim > 1 or not turns.is_wide(own, step.angular_states):
            return False
        self.aside.append(at)
        return True

    def take(self, error: FilterError, k: int) -> bool:
        """Return whether the batch can continue without the filter that failed at measurement k.

        A failure at the first measurement is that of an argument, not of a filter.
        """
        if not k or not error.member or not isinstance(error, SpreadError | NotPositiveDefiniteError):
            return False
        if len(self._left) < 2:
            return False
        (member,) = error.member
        self._left.remove(member)
        self.aside = [at for at in self.aside if at != member]
        self._lost.append(Lost(member, k, error))
        return True

    @property
    def has_active(self) -> bool:
        """Whether any filter is neither lost nor aside."""
        return len(self.aside) < max(len(self._left), 1)

    @property
    def rows(self) -> Array:
        """Row of each filter of a batch, or of the one that stands in for it."""
        own = [at for at in self._left if at not in self.aside] or self._left
        rows = np.full(self._members, own[0])
        rows[own] = own
        return rows

    def replaced(self, state: Any) -> Any:
        """Return a state, or an array (B, ...), of a batch with the rows of stand-ins.

        They are those of the lost and of the put aside.
        """
        if not self._lost and not self.aside:
            return state
        rows = self.rows
        return _each_array(lambda array: array[rows] if array.shape[:1] == rows.shape else array, state)

    def blanked(self, found: Run) -> Run:
        """Return the run, without the stand-ins of failed filters."""
        if not self._lost:
            return found
        for b, k, _ in self._lost:
            for array in (*found.predictions, *found.beliefs, *found[2:5], found.log_likelihood):
                array[k:, b] = np.nan
            found.nis[k:, b] = found.degrees[k:, b] = found.wide[k:, b] = 0
        return found._replace(lost=tuple(self._lost))


def _placed(error: FilterError, k: int, ts: Array, found: Run | None) -> FilterError:
    """Return the error with the measurement that failed, and the run before it."""
    placed = type(error)(f"ys[{k}], t = {ts[k]:g}: {error}")
    placed.member, placed.found = error.member, found
    return placed


def _collected(made: list[_Outcome], method: Method, model: AnyModel, ts: Array) -> Run:
    """Stack the steps' predictions, beliefs and updates."""
    predictions, beliefs, updates, wide = zip(*made, strict=True)
    size = max(u.innovation.shape[-1] for u in updates)
    innovation = np.stack([_padded(u.innovation, size, 1) for u in updates])
    S = np.stack([_padded(u.innovation_covariance, size, 2) for u in updates])
    nis = np.stack([np.asarray(u.nis, float) for u in updates])
    log_l = _gaussian(nis, S)
    for k, update in enumerate(updates):
        if getattr(update, "log_evidence", None) is not None:
            log_l[k] = update.log_evidence
    return Run(
        Belief(*(np.stack(part) for part in zip(*predictions, strict=True))),
        Belief(*(np.stack(part) for part in zip(*beliefs, strict=True))),
        innovation,
        S,
        np.stack([_padded(u.predicted, size, 1) for u in updates]),
        nis,
        np.sum(~np.isnan(innovation), axis=-1),
        log_l,
        tuple(u.belief for u in updates),
        method,
        model,
        ts,
        np.array(wide),
    )


def _padded(array: Array, size: int, axes: int) -> Array:
    """Fill an array with NaN up to `size` in its last axes."""
    more = size - array.shape[-1]
    fill = [(0, 0)] * (array.ndim - axes) + [(0, more)] * axes
    return np.pad(array, fill, constant_values=np.nan) if more else array


def _compiled(method: Method, model: LinearModel, start: Belief, ys: list[Array], ts: Array) -> Run:
    """Run the linear Kalman filter in one compiled loop."""
    from onboard.filters.kernels import records  # noqa: PLC0415 - the compiler loads when it is needed

    lead = start.mean.shape[:-1]
    n, m, steps = start.mean.shape[-1], ys[0].shape[-1], len(ys)
    mean, P = (start.mean, start.covariance) if lead else (start.mean[None], start.covariance[None])
    y = np.stack(ys).reshape(steps, len(mean), m)
    H, R, F, Q = (a if a.ndim == 3 else a[None] for a in (model.H, model.R, model.F, model.Q))
    u = np.zeros((1, n)) if model.inputs is None else model.inputs
    kernel: Any = records.filter_record
    *found, status = kernel(mean, P, F, Q, u, H, R, y, mask(model.angular, m))
    if status:  # a filter fails: step by step, the others go on
        return _stepped(method, model, start, ys, ts)
    shaped = [a.reshape(len(a), *lead, *a.shape[2:]) for a in found]
    prior, prior_P, after, after_P, innovation, S, predicted, nis, log_l = shaped
    degrees = np.sum(~np.isnan(innovation), axis=-1)
    states = tuple(Belief(*one) for one in zip(after, after_P, strict=True))
    return Run(
        Belief(prior, prior_P), Belief(after, after_P), innovation, S, predicted, nis, degrees, log_l, states,
        method, model, ts, np.zeros(nis.shape, bool),
    )  # fmt: skip


def _fitted(model: LinearModel, start: Belief, ys: list[Array], ts: Array) -> LinearModel:
    """Return the model in the record's shapes.

    Raises FilterError.
    """
    n, m = start.mean.shape[-1], ys[0].shape[-1]
    made = model.fitted(n, m, len(ys))
    if m == 0 or any(one.shape != ys[0].shape for one in ys):
        raise FilterError("ys: must be of one size for a LinearModel, with NaN where a component is missing")
    if not np.all(np.diff(ts) > 0):
        raise FilterError("ts: must increase for a LinearModel, whose F leads from each measurement to the next")
    return made


def _measurements(ys: Any, start: Belief) -> list[Array]:
    """Return each measurement, with NaN where it is missing."""
    lead = start.mean.shape[:-1]
    if isinstance(ys, np.ndarray) and ys.ndim == 1 and not lead:
        ys = ys[:, None]
    if isinstance(ys, np.ndarray) and ys.dtype != object:  # a record at once, not measurement by measurement
        ys = np.ma.filled(np.ma.asarray(ys, float), np.nan)
    known = next((np.shape(y) for y in ys if y is not None), (*lead, 1))
    found = []
    for k, y in enumerate(ys):
        if y is None:
            one = np.full(known, np.nan)
        elif type(y) is np.ndarray and y.dtype == np.float64:
            one = y
        else:
            one = np.asarray(np.ma.filled(np.ma.asarray(y, float), np.nan))
        if one.shape[:-1] != lead or one.ndim != len(lead) + 1:
            wanted = "(T, B, m)" if lead else "(T, m)"
            raise FilterError(f"ys[{k}]: has shape {one.shape}; ys must be {wanted} for mean {start.mean.shape}")
        found.append(one)
    if not found:
        raise FilterError("ys: has no measurement")
    return found


def _times(ts: Any, count: int) -> Array:
    times = np.arange(float(count)) if ts is None else seconds(ts)
    if times.shape != (count,) or not np.isfinite(times).all():
        raise FilterError(f"ts: must be {count} finite times, one for each of ys, not of shape {times.shape}")
    late = np.flatnonzero(np.diff(times) < 0)
    if len(late):
        k = int(late[0]) + 1
        raise FilterError(
            f"ts[{k}] = {times[k]:g} is before ts[{k - 1}] = {times[k - 1]:g}: put the record in the order of its "
            "times, order = np.argsort(ts, kind='stable')"
        )
    return times
