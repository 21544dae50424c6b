/* A co-simulation FMU for the tests of knothe.states.fmu, of FMI 2.0 or (-DFMI=3) 3.0: m x'' + c x' + k x = u, a millisecond a step of Heun's
 * method. Value references: 0 x, 1 v, 2 acceleration, 3 u, 4 k, 5 c. It crashes where x is above 10. */
#include <stddef.h>
#include <stdlib.h>

static void rates(const double *value, double x, double v, double *dx, double *dv) {
  *dx = v;
  *dv = value[3] - value[4] * x - value[5] * v;
}

static void advance(double *value, double dt) {
  long count = (long)(dt / 1e-3 + 0.5);
  for (long i = 0; i < count; ++i) {
    double h = dt / (double)count, a, b, c, d;
    rates(value, value[0], value[1], &a, &b);
    rates(value, value[0] + h * a, value[1] + h * b, &c, &d);
    value[0] += 0.5 * h * (a + c);
    value[1] += 0.5 * h * (b + d);
  }
  if (value[0] > 10) abort();
}

static void start(double *value) {
  value[0] = 1, value[1] = 0, value[2] = 0, value[3] = 0, value[4] = 9, value[5] = 0.4;
}

static void get(const double *value, const unsigned *reference, size_t count, double *result) {
  for (size_t i = 0; i < count; ++i)
    result[i] = reference[i] == 2 ? value[3] - value[4] * value[0] - value[5] * value[1] : value[reference[i]];
}

static void set(double *value, const unsigned *reference, size_t count, const double *given) {
  for (size_t i = 0; i < count; ++i) value[reference[i]] = given[i];
}

static void *instantiated(void) {
  double *value = malloc(6 * sizeof *value);
  start(value);
  return value;
}

#if FMI == 3
const char *fmi3GetVersion(void) { return "3.0"; }
void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, _Bool visible, _Bool logging, _Bool event, _Bool early,
                                  const unsigned *required, size_t count, void *environment, void *log, void *intermediate) {
  return instantiated();
}
void fmi3FreeInstance(void *c) { free(c); }
int fmi3EnterInitializationMode(void *c, _Bool has_tolerance, double tolerance, double t, _Bool has_stop, double stop) { return 0; }
int fmi3ExitInitializationMode(void *c) { return 0; }
int fmi3EnterStepMode(void *c) { return 0; }
int fmi3Terminate(void *c) { return 0; }
int fmi3Reset(void *c) { return start(c), 0; }
int fmi3GetFloat64(void *c, const unsigned *reference, size_t count, double *value, size_t n) { return get(c, reference, count, value), 0; }
int fmi3SetFloat64(void *c, const unsigned *reference, size_t count, const double *value, size_t n) { return set(c, reference, count, value), 0; }
int fmi3DoStep(void *c, double t, double dt, _Bool no_state, _Bool *event, _Bool *terminate, _Bool *early, double *last) {
  advance(c, dt);
  *event = *terminate = *early = 0;
  *last = t + dt;
  return 0;
}
#else
const char *fmi2GetVersion(void) { return "2.0"; }
const char *fmi2GetTypesPlatform(void) { return "default"; }
void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *functions, int visible, int logging) {
  return instantiated();
}
void fmi2FreeInstance(void *c) { free(c); }
int fmi2SetupExperiment(void *c, int has_tolerance, double tolerance, double t, int has_stop, double stop) { return 0; }
int fmi2EnterInitializationMode(void *c) { return 0; }
int fmi2ExitInitializationMode(void *c) { return 0; }
int fmi2Terminate(void *c) { return 0; }
int fmi2Reset(void *c) { return start(c), 0; }
int fmi2GetReal(void *c, const unsigned *reference, size_t count, double *value) { return get(c, reference, count, value), 0; }
int fmi2SetReal(void *c, const unsigned *reference, size_t count, const double *value) { return set(c, reference, count, value), 0; }
int fmi2DoStep(void *c, double t, double dt, int no_state) { return advance(c, dt), 0; }
#endif
