/* Twin of a tick of force/sensor.py: from a reading to the wrench that the tool exerts, in the base frame.

       W = -Ad*_{base<-sensor} deadband(smooth(reading - bias - weight(R))) */

#include "press.h"
#include <string.h>

/* A vector shortened by `width`. */
static void soft(double vector[3], double width)
{
    double length = norm(3, vector), share = length > width ? 1.0 - width / length : 0.0;
    for (int i = 0; i < 3; i++)
        vector[i] *= share;
}

/* What the sensor at a pose reads with nothing touching the tool. */
static void unloaded(const Press *press, const Pose *sensor, double reading[6])
{
    double sign = press->reaction ? 1.0 : -1.0, f[3], m[3];
    memcpy(reading, press->bias, sizeof press->bias);
    if (press->mass == 0.0)
        return;
    for (int i = 0; i < 3; i++)
        f[i] = press->mass * (sensor->R[0][i] * press->gravity[0] + sensor->R[1][i] * press->gravity[1] + sensor->R[2][i] * press->gravity[2]);
    cross(press->centre, f, m);
    for (int i = 0; i < 3; i++) {
        reading[i] += sign * m[i];
        reading[3 + i] += sign * f[i];
    }
}

static void deadband(const Press *press, double w[6])
{
    double lever[3];
    if (press->force_deadband == 0.0 && press->moment_deadband == 0.0)
        return;
    cross(press->origin, w + 3, lever);
    for (int i = 0; i < 3; i++)
        w[i] -= lever[i];
    soft(w + 3, press->force_deadband);
    soft(w, press->moment_deadband);
    cross(press->origin, w + 3, lever);
    for (int i = 0; i < 3; i++)
        w[i] += lever[i];
}

/* The wrench that the tool exerts, raw and cleaned, and the low-pass after a reading; `smooth` is NaN before the first. */
void cleaned(const Press *press, const double reading[6], const Pose *tool, double smooth[6], double raw[6], double measured[6])
{
    Pose mount, sensor;
    double load[6], clean[6];
    if (!press->has_sensor) {
        memcpy(raw, reading, 6 * sizeof(double));
        memcpy(measured, reading, 6 * sizeof(double));
        return;
    }
    pose_from(press->mount[0], &mount);
    product(tool, &mount, &sensor);
    unloaded(press, &sensor, load);
    bool first = isnan(smooth[0]);
    for (int i = 0; i < 6; i++) {
        load[i] = press->reaction ? -(reading[i] - load[i]) : reading[i] - load[i];
        smooth[i] = first ? load[i] : smooth[i] + press->share * (load[i] - smooth[i]);
        clean[i] = smooth[i];
    }
    deadband(press, clean);
    wrench_out(&sensor, load, raw);
    wrench_out(&sensor, clean, measured);
}
