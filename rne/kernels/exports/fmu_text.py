"""Text in C around the equations of a Functional Mock-up Unit: its states, events, integrator and functions.

Functions and types have the names and arguments of the FMI standard, 2.0.4 and 3.0.2. A value reference is a place in
one array of all variables, whose blocks T, X, U, ... begin where an enumeration in front of the text says.
"""

from __future__ import annotations

import re

MODEL = r"""
typedef struct { /* all that changes: what a saved state is */
    double v[NV], queue[QUEUE][N], z[M + 1], h, tolerance;
    int64_t sampled, acted, broken, is_started, has_ended;
} Memory;

static int rates_at(const Memory *m, double t, const double *x, double *result)
{
    /* up to its event a break belongs to what is before it */
    const double at = m->broken < BREAKS && t >= breaks[m->broken] ? nextafter(breaks[m->broken], -INFINITY) : t;
    int has_failed = RATES(&at, x, m, result);
    for (int k = 0; k < R; k++)
        has_failed |= !isfinite(result[k]);
    return has_failed;
}

static int now(Memory *m) { return rates_at(m, m->v[T], &m->v[X], &m->v[DX]); }

static void begin(Memory *m) /* at the start values */
{
    memcpy(&m->v[X], &m->v[Q0], (QD0 - Q0) * sizeof(double));
    if (QD0 - Q0 < C)
        (void)MOTORS(&m->v[Q0], m, &m->v[X + QD0 - Q0]);
    for (int k = 0; k < C; k++)
        m->v[X + C + k] = m->v[QD0 + k % (NV - QD0)];
    m->sampled = m->acted = SAMPLED ? (int64_t)ceil(m->v[T] / PERIOD - 1e-9) : 0;
    for (m->broken = 0; m->broken < BREAKS && breaks[m->broken] <= m->v[T]; m->broken++)
        ;
}

static double coming(const Memory *m) /* time of the next sample, command or break */
{
    if (SAMPLED)
        return fmin((double)m->sampled * PERIOD, ((double)m->acted + LATE) * PERIOD + REST);
    return m->broken < BREAKS ? breaks[m->broken] : INFINITY;
}

static int renew(Memory *m) /* take the samples, and have the commands act, that are due */
{
    while (m->broken < BREAKS && breaks[m->broken] <= m->v[T])
        m->broken++;
    while (SAMPLED && coming(m) <= m->v[T] + SLACK) {
        const double sample = (double)m->sampled * PERIOD;
        if (sample > m->v[T] + SLACK) {
            memcpy(&m->v[U], m->queue[m->acted++ % QUEUE], sizeof m->queue[0]);
            continue;
        }
        double row[S + M], found[N + M], *queued = m->queue[m->sampled++ % QUEUE];
        memcpy(row, &m->v[X], S * sizeof(double));
        memcpy(row + S, m->z, M * sizeof(double));
        memcpy(&m->v[Z], m->z, M * sizeof(double));
        if (LAW(&sample, row, m, found))
            return 1;
        for (int i = 0; i < N + M; i++) {
            if (!isfinite(found[i]))
                return 1;
            *(i < N ? &queued[i] : &m->z[i - N]) = i < N ? fmin(fmax(found[i], -LIMIT(m)[i]), LIMIT(m)[i])
                                                         : KEEP * m->z[i - N] + GAIN * found[i];
        }
    }
    return 0;
}

/* A step of Dormand and Prince's method of order 8, with both estimates of its error: Hairer, Norsett and Wanner 1993,
   Solving Ordinary Differential Equations I, section II.10. */
static int step(const Memory *m, double h, double *x, double *result, double *error)
{
    double k[STAGES + 1][R], squares[2] = {0.0, 0.0}, sum;
    memcpy(k[0], &m->v[DX], sizeof k[0]);
    for (int s = 1; s <= STAGES; s++) {
        for (int i = 0; i < S; i++) {
            sum = 0.0;
            for (int r = 0; r < s; r++)
                sum += a[s][r] * k[r][i];
            x[i] = m->v[X + i] + h * sum;
        }
        if (rates_at(m, m->v[T] + c[s] * h, x, k[s]))
            return 1;
    }
    memcpy(result, k[STAGES], sizeof k[0]);
    for (int i = 0; i < 2 * S; i++) {
        sum = 0.0;
        for (int r = 0; r <= STAGES; r++)
            sum += e[i % 2][r] * k[r][i / 2];
        sum /= m->tolerance * (1.0 + fmax(fabs(x[i / 2]), fabs(m->v[X + i / 2])));
        squares[i % 2] += sum * sum;
    }
    sum = squares[0] + 0.01 * squares[1];
    *error = sum > 0.0 ? h * squares[0] / sqrt(sum * S) : 0.0;
    return 0;
}

static int stopped(const double *result) /* is a joint beyond a stop? */
{
    int is_beyond = 0;
    for (int k = STOP - DX; k < R; k++)
        is_beyond |= result[k] <= 0.0;
    return is_beyond;
}

static int integrate(Memory *m, double until)
{
    double x[S], result[R], error, within = 0.0, middle;
    while (m->v[T] < until && !m->has_ended) {
        const int is_last = m->h >= (until - m->v[T]) * (1.0 - 1e-9);
        double h = is_last ? until - m->v[T] : m->h;
        if (step(m, h, x, result, &error) || !(error <= 1.0)) {
            m->h = h * fmax(0.2, 0.9 * pow(error, -0.125));
            if (m->h <= 1e-15 * fmax(1.0, fabs(m->v[T])))
                return 1;
            continue;
        }
        const double next = h * fmin(10.0, 0.9 * pow(error, -0.125));
        m->h = is_last ? fmax(m->h, next) : next;
        if (stopped(result)) { /* the shortest step that ends there, by bisection */
            m->has_ended = 1;
            while ((middle = 0.5 * (within + h)) > within && middle < h)
                *(!step(m, middle, x, result, &error) && stopped(result) ? &h : &within) = middle;
            step(m, h, x, result, &error);
        }
        m->v[T] = is_last && !m->has_ended ? until : m->v[T] + h;
        memcpy(&m->v[X], x, sizeof x);
        memcpy(&m->v[DX], result, sizeof result);
    }
    return 0;
}

static int advance(Memory *m, double end)
{
    int has_failed = 0;
    while (m->v[T] < end && !m->has_ended && !has_failed)
        has_failed = renew(m) || now(m) || integrate(m, coming(m) < end - SLACK ? coming(m) : end);
    return has_failed;
}

typedef struct {
    Memory m;
    double slopes[R][K];
    int is_current, has_slopes, is_stepped;
    void *environment;
    Logger log;
    char name[64];
} Instance;

static Status said(Instance *c, Status status, const char *text)
{
    if (c->log)
        LOG(c, status, text);
    return status;
}

static Status failed(Instance *c)
{
    return said(c, Error, "M is singular, a number is not finite, or the time is outside a motion's samples");
}

static Status reset(Instance *c)
{
    memset(&c->m, 0, sizeof c->m);
    memcpy(c->m.v, starts, sizeof starts);
    c->m.h = 1e-4;
    c->m.tolerance = TOLERANCE;
    c->is_current = 0;
    return OK;
}

static Instance *make(const char *name, const char *token, int is_stepped, void *environment, Logger log)
{
    Instance *c = calloc(1, sizeof *c), own = {.environment = environment, .log = log, .is_stepped = is_stepped};
    if (!c)
        return NULL;
    *c = own;
    strncat(c->name, name ? name : "", sizeof c->name - 1);
    reset(c);
    if (token && !strcmp(token, TOKEN))
        return c;
    said(c, Error, "the model description is that of another unit");
    free(c);
    return NULL;
}

static Status setup(Instance *c, int has_tolerance, double tolerance, double start)
{
    c->is_current = 0;
    c->m.v[T] = start;
    c->m.tolerance = has_tolerance && tolerance > 0.0 ? tolerance : TOLERANCE;
    return OK;
}

static Status update(Instance *c) /* all results follow time, states and inputs */
{
    if (!c->is_current && !c->m.is_started)
        begin(&c->m);
    c->has_slopes &= c->is_current;
    c->is_current = c->is_current || !now(&c->m);
    return c->is_current ? OK : failed(c);
}

static Status get(Instance *c, const Reference *vr, size_t n, double *values)
{
    Memory ahead;
    const Memory *m = &c->m;
    if (update(c))
        return Error;
    if (SAMPLED && (c->is_stepped || !m->is_started) && coming(m) <= m->v[T] + SLACK) { /* as the next step begins */
        ahead = *m;
        m = &ahead;
        if (renew(&ahead) || now(&ahead))
            return failed(c);
    }
    for (size_t k = 0; k < n; k++) {
        if (vr[k] >= NV)
            return said(c, Error, "there is no variable with this value reference");
        values[k] = m->v[vr[k]];
    }
    return OK;
}

static Status set(Instance *c, const Reference *vr, size_t n, const double *values)
{
    for (size_t k = 0; k < n; k++) {
        const int is_start = vr[k] >= Q0 && vr[k] < NV, is_input = vr[k] >= INPUTS && vr[k] < DX;
        if (!is_input && (!is_start || c->m.is_started))
            return said(c, Error, "inputs and numbers can be set, and until initialization ends start values");
        if (!isfinite(values[k]))
            return said(c, Error, "a value is not finite");
        c->m.v[vr[k]] = values[k];
    }
    c->is_current = 0;
    return OK;
}

static Status block(Instance *c, Reference first, double *values, size_t n)
{
    const Status status = update(c);
    memcpy(values, &c->m.v[first], n * sizeof *values);
    return status;
}

static Status event(Instance *c, Flag *terminate, Flag *is_timed, double *next)
{
    if (renew(&c->m))
        return failed(c);
    c->is_current = 0;
    const Status status = update(c);
    *terminate = c->m.has_ended |= stopped(&c->m.v[DX]);
    *next = coming(&c->m);
    *is_timed = *next < INFINITY;
    return c->m.has_ended ? said(c, status, "a joint reached its stop") : status;
}

static Status advanced(Instance *c, double t, double h)
{
    if (fabs(t - c->m.v[T]) > 1e-9 * fmax(1.0, fabs(t)))
        return said(c, Error, "a step must begin where the last one ended");
    if (!(h >= 0.0) || advance(&c->m, t + h))
        return failed(c);
    c->is_current = 0;
    return c->m.has_ended ? said(c, AT_STOP, "a joint reached its stop") : OK;
}

static Status derive(Instance *c, const Reference *unknowns, size_t rows, const Reference *knowns, size_t columns,
                     const double *seeds, double *found, int is_adjoint)
{
    if (update(c)) /* which fails outside of a motion's samples */
        return Error;
    for (int r = 0; r < R && !c->has_slopes; r++) {
        double weights[R] = {0.0};
        weights[r] = 1.0;
        if (GRADIENT(&c->m.v[T], &c->m.v[X], &c->m, weights, c->slopes[r]))
            return failed(c);
    }
    c->has_slopes = 1;
    memset(found, 0, (is_adjoint ? columns : rows) * sizeof *found);
    for (size_t k = 0; k < rows * columns; k++) {
        const size_t i = k / columns, j = k % columns;
        const Reference row = unknowns[i] - DX, state = unknowns[i] - X, column = knowns[j] - X;
        if (column >= K || (row >= R && state >= S))
            return said(c, Error, "derivatives are those of outputs and rates by states, inputs and numbers");
        found[is_adjoint ? j : i] += (row < R ? c->slopes[row][column] : state == column) * seeds[is_adjoint ? i : j];
    }
    return OK;
}
"""

# Functions of an instance: the arguments behind it, and what comes before `return OK`.
BOTH = """
SetDebugLogging(Flag on, size_t n, const char *const *categories):
ExitInitializationMode(): if (update(c)) return Error; c->m.is_started = 1;
Terminate():
Reset(): reset(c);
EnterEventMode():
EnterContinuousTimeMode():
CompletedIntegratorStep(Flag is_final, Flag *enter, Flag *terminate): *enter = *terminate = 0;
SetTime(double t): c->is_current = 0; c->m.v[T] = t;
SetContinuousStates(const double *x, size_t n): c->is_current = 0; memcpy(&c->m.v[X], x, (n < S ? n : S) * sizeof *x);
GetContinuousStates(double *x, size_t n): return block(c, X, x, n);
GetEventIndicators(double *z, size_t n): return block(c, STOP, z, n);
GetNominalsOfContinuousStates(double *x, size_t n): while (n--) x[n] = 1.0;
GetFMUState(Memory **s): if (update(c) || (!*s && !(*s = malloc(sizeof **s)))) return Error; **s = c->m;
SetFMUState(const Memory *state): c->m = *state; c->is_current = 0;
FreeFMUState(Memory **state): free(*state); *state = NULL;
SerializedFMUStateSize(const Memory *state, size_t *size): *size = sizeof *state;
SerializeFMUState(const Memory *s, char *to, size_t n): if (n < sizeof *s) return Error; memcpy(to, s, sizeof *s);
DeserializeFMUState(const char *bytes, size_t n, Memory **s):
    if (n != sizeof **s || !(*s = malloc(n))) return Error; memcpy(*s, bytes, n);
"""
TYPES = {
    "2.0": """
typedef enum { OK, Warning, Discard, Error, Fatal, Pending } Status;
typedef unsigned int Reference;
typedef int Flag;
typedef void (*Logger)(void *, const char *, Status, const char *, const char *, ...);
typedef struct { Logger log; void *allocate, *release, *finished, *environment; } Callbacks;
typedef struct { Flag again, terminate, nominals, values, is_timed; double next; } EventInfo;
#define LOG(c, status, text) c->log(c->environment, c->name, status, "rne", "%s", text)
#define AT_STOP Discard
""",
    "3.0": """
typedef enum { OK, Warning, Discard, Error, Fatal } Status;
typedef uint32_t Reference;
typedef bool Flag;
typedef void (*Logger)(void *, Status, const char *, const char *);
#define LOG(c, status, text) c->log(c->environment, status, "rne", text)
#define AT_STOP OK
""",
}
MAKERS = {
    "2.0": """
API const char *F(GetTypesPlatform)(void) { return "default"; }
API Instance *F(Instantiate)(const char *name, int type, const char *guid, const char *resources,
                             const Callbacks *given, Flag is_visible, Flag is_logging)
{
    return make(name, guid, type == 1, given ? given->environment : NULL, given ? given->log : NULL);
}
""",
    "3.0": """
API Instance *F(InstantiateModelExchange)(const char *name, const char *token, const char *resources, Flag is_visible,
                                          Flag is_logging, void *environment, Logger log)
{
    return make(name, token, 0, environment, log);
}
API Instance *F(InstantiateCoSimulation)(const char *name, const char *token, const char *resources, Flag is_visible,
                                         Flag is_logging, Flag has_events, Flag returns_early, const Reference *vr,
                                         size_t n, void *environment, Logger log, void (*between)(void))
{
    return has_events ? NULL : make(name, token, 1, environment, log);
}
API Instance *F(InstantiateScheduledExecution)(const char *name, const char *token, const char *resources,
                                               Flag is_visible, Flag is_logging, void *environment, Logger log,
                                               void (*update)(void), void (*lock)(void), void (*unlock)(void))
{
    return NULL;
}
""",
}
FUNCTIONS = {
    "2.0": """
SetupExperiment(Flag is_given, double tolerance, double t, Flag has_end, double end): setup(c, is_given, tolerance, t);
EnterInitializationMode():
GetReal(const Reference *vr, size_t n, double *values): return get(c, vr, n, values);
SetReal(const Reference *vr, size_t n, const double *values): return set(c, vr, n, values);
GetDirectionalDerivative(const Reference *f, size_t m, const Reference *x, size_t n, const double *dx, double *df):
    return derive(c, f, m, x, n, dx, df, 0);
GetDerivatives(double *dx, size_t n): return block(c, DX, dx, n);
NewDiscreteStates(EventInfo *i): i->again = i->nominals = i->values = 0;
    return event(c, &i->terminate, &i->is_timed, &i->next);
DoStep(double t, double h, Flag is_final): return advanced(c, t, h);
CancelStep(): return Error;
GetStatus(int kind, Status *value): *value = OK;
GetRealStatus(int kind, double *value): *value = c->m.v[T]; if (kind != 2) return Discard;
GetBooleanStatus(int kind, Flag *value): *value = (Flag)c->m.has_ended; if (kind != 3) return Discard;
GetIntegerStatus(int kind, int *value): return Discard;
GetStringStatus(int kind, const char **value): return Discard;
SetRealInputDerivatives(const Reference *vr, size_t n, const int *order, const double *values): if (n) return Error;
GetRealOutputDerivatives(const Reference *vr, size_t n, const int *order, double *values): if (n) return Error;
""",
    "3.0": """
EnterInitializationMode(Flag is_given, double tolerance, double t, Flag has_end, double end):
    setup(c, is_given, tolerance, t);
GetFloat64(const Reference *vr, size_t n, double *x, size_t m): return n == m ? get(c, vr, n, x) : Error;
SetFloat64(const Reference *vr, size_t n, const double *x, size_t m): return n == m ? set(c, vr, n, x) : Error;
GetDirectionalDerivative(const Reference *f, size_t m, const Reference *x, size_t n, const double *dx, size_t k,
    double *df, size_t l): if (k != n || l != m) return Error; return derive(c, f, m, x, n, dx, df, 0);
GetAdjointDerivative(const Reference *f, size_t m, const Reference *x, size_t n, const double *df, size_t k,
    double *dx, size_t l): if (k != m || l != n) return Error; return derive(c, f, m, x, n, df, dx, 1);
GetContinuousStateDerivatives(double *dx, size_t n): return block(c, DX, dx, n);
GetNumberOfContinuousStates(size_t *n): *n = S;
GetNumberOfEventIndicators(size_t *n): *n = DX + R - STOP;
UpdateDiscreteStates(Flag *again, Flag *end, Flag *nominals, Flag *values, Flag *is_timed, double *next):
    *again = *nominals = *values = false; return event(c, end, is_timed, next);
DoStep(double t, double h, Flag is_final, Flag *event, Flag *end, Flag *early, double *last):
    const Status status = advanced(c, t, h); *event = false; *end = *early = c->m.has_ended != 0; *last = c->m.v[T];
    return status;
GetBinary(const Reference *vr, size_t n, size_t *sizes, const uint8_t **x, size_t m): if (n) return Error;
SetBinary(const Reference *vr, size_t n, const size_t *sizes, const uint8_t *const *x, size_t m): if (n) return Error;
GetClock(const Reference *vr, size_t n, bool *values): if (n) return Error;
SetClock(const Reference *vr, size_t n, const bool *values): if (n) return Error;
GetIntervalDecimal(const Reference *vr, size_t n, double *intervals, int *kinds): if (n) return Error;
SetIntervalDecimal(const Reference *vr, size_t n, const double *intervals): if (n) return Error;
GetIntervalFraction(const Reference *vr, size_t n, uint64_t *a, uint64_t *b, int *kinds): if (n) return Error;
SetIntervalFraction(const Reference *vr, size_t n, const uint64_t *a, const uint64_t *b): if (n) return Error;
GetShiftDecimal(const Reference *vr, size_t n, double *shifts): if (n) return Error;
SetShiftDecimal(const Reference *vr, size_t n, const double *shifts): if (n) return Error;
GetShiftFraction(const Reference *vr, size_t n, uint64_t *a, uint64_t *b): if (n) return Error;
SetShiftFraction(const Reference *vr, size_t n, const uint64_t *a, const uint64_t *b): if (n) return Error;
GetOutputDerivatives(const Reference *vr, size_t n, const int32_t *orders, double *x, size_t m): if (n) return Error;
GetNumberOfVariableDependencies(Reference vr, size_t *n): return Error;
GetVariableDependencies(Reference vr, size_t *of, Reference *by, size_t *places, int *kinds, size_t n): return Error;
EnterConfigurationMode(): return Error;
ExitConfigurationMode(): return Error;
EvaluateDiscreteStates(): return Error;
EnterStepMode(): return Error;
ActivateModelPartition(Reference clock, double t): return Error;
""",
}
INTEGERS = {f"{u}Int{k}": f"{u.lower()}int{k}_t" for u in ("", "U") for k in (8, 16, 32, 64)}
ABSENT = {
    "2.0": {"Integer": "int", "Boolean": "Flag", "String": "char *"},
    "3.0": {"Float32": "float", "String": "char *", **INTEGERS, "Boolean": "bool"},
}


def text_around(version: str) -> str:
    """Text in C that follows the equations of a unit and its numbers."""
    rows, count = BOTH + FUNCTIONS[version], "" if version == "2.0" else ", size_t m"
    if version == "2.0":
        rows = rows.replace("FMUState", "FMUstate").replace("Deserialize", "DeSerialize")
    for name, kind in ABSENT[version].items():
        for verb, const in (("Get", ""), ("Set", "const ")):
            rows += f"{verb}{name}(const Reference *vr, size_t n, {const}{kind} *values{count}): if (n) return Error;\n"
    row = re.compile(r"^(\w+)\(([^)]*)\):", re.MULTILINE)
    found = []
    for head, body in zip(row.finditer(rows), row.split(rows)[3::3], strict=True):
        arguments = ", ".join(["Instance *c", *filter(None, [" ".join(head[2].split())])])
        lines = [*re.split(r"(?<=;)\s+", body.strip()), "return OK;"]
        found += [f"API Status F({head[1]})({arguments})", "{", *(f"    {line}" for line in lines if line), "}"]
    names = f"""
#ifndef FMI{version[0]}_FUNCTION_PREFIX
#define FMI{version[0]}_FUNCTION_PREFIX
#endif
#define F(name) JOINED(FMI{version[0]}_FUNCTION_PREFIX, fmi{version[0]}##name)
#define JOINED(a, b) PASTED(a, b)
#define PASTED(a, b) a##b
#ifdef _WIN32
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif
API const char *F(GetVersion)(void) {{ return "{version}"; }}
API void F(FreeInstance)(Instance *c) {{ free(c); }}"""
    return "\n".join([TYPES[version], MODEL, names, MAKERS[version], *found, ""])
