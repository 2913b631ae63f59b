/* One step of the leg observer, written out by hand in C as one would: the anchor that `gaitd bench`
 * measures observer/ against. Same model, integrators, substeps and square-root form, the C library's
 * functions, no gate and no status. Shares no code with observer/.
 *
 * States: hip angle, slide position, their velocities, two frictions, two disturbances.
 */
#include <math.h>
#include <string.h>

enum { N = 8, M = 2, POINTS = 2 * N + 1 };

typedef struct {
    double l1, l2, l3, thigh_angle, rail_x, rail_y, rail_cos, rail_sin;
    double inertia1, inertia2, inertia3, slide_inertia;
    double k1_re, k1_im, k2_re, k2_im, k3_re, k3_im;
    double slide_weight, hip_stiffness, hip_rest, slide_stiffness, slide_rest;
    double d_hip, d_knee, d_ankle, d_slide, smallest_delta;
} Leg;

typedef struct {
    double stribeck, coulomb, viscous, transition, peak, edge, time_constant;
    double bristle_stiffness, bristle_damping; /* 0: only eq. (11) is written here */
} Friction;

typedef struct {
    Leg leg;
    Friction friction[2];
    double coriolis;
    double process_std[N];
    double measurement_std[M];
} Model;

static const double GRAVITY = 9.81;

/* Acceleration of both coordinates under generalised forces. */
static void accelerate(const Leg *p, double coriolis, const double *q, const double *v,
                       const double *force, double *a)
{
    double th = p->thigh_angle + q[0];
    double kx = p->l1 * cos(th), ky = p->l1 * sin(th);
    double dx = p->rail_x + q[1] * p->rail_cos - kx, dy = p->rail_y + q[1] * p->rail_sin - ky;
    double d2 = dx * dx + dy * dy;
    double half = 0.5 * (p->l2 * p->l2 - p->l3 * p->l3 + d2);
    double delta2 = p->l2 * p->l2 * d2 - half * half;
    double delta = sqrt(fmax(delta2, p->smallest_delta * p->smallest_delta));
    double alpha = half / d2, eta = delta / d2;
    double ux = alpha * dx + eta * dy, uy = alpha * dy - eta * dx;
    double wx = ux - dx, wy = uy - dy;
    double o = -1.0 / delta;

    double w2h = (ky * wx - kx * wy) * o, w2s = (p->rail_cos * wx + p->rail_sin * wy) * o;
    double w3h = (ky * ux - kx * uy) * o, w3s = (p->rail_cos * ux + p->rail_sin * uy) * o;

    double x2 = p->k2_re * ux - p->k2_im * uy, y2 = p->k2_re * uy + p->k2_im * ux;
    double x3 = p->k3_re * wx - p->k3_im * wy, y3 = p->k3_re * wy + p->k3_im * wx;
    double b12 = kx * x2 + ky * y2, b13 = -(kx * x3 + ky * y3), b23 = -(ux * x3 + uy * y3);
    double e12 = kx * y2 - ky * x2, e13 = ky * x3 - kx * y3, e23 = uy * x3 - ux * y3;

    double p2 = b12 + p->inertia2 * w2h + b23 * w3h, p3 = b13 + p->inertia3 * w3h + b23 * w2h;
    double m11 = p->inertia1 + b12 * w2h + b13 * w3h + w2h * p2 + w3h * p3;
    double m12 = w2s * p2 + w3s * p3;
    double m22 = p->slide_inertia + w2s * (p->inertia2 * w2s + b23 * w3s)
                 + w3s * (p->inertia3 * w3s + b23 * w2s);

    double r2 = w2h * v[0] + w2s * v[1], r3 = w3h * v[0] + w3s * v[1];
    double s1 = coriolis * v[0] * v[0], s2 = coriolis * r2 * r2, s3 = coriolis * r3 * r3;
    double uw = ux * wx + uy * wy;
    double al2 = (s1 * (kx * wx + ky * wy) + s2 * uw - s3 * p->l3 * p->l3) * o;
    double al3 = (s1 * (kx * ux + ky * uy) + s2 * p->l2 * p->l2 - s3 * uw) * o;

    double knee = p->d_knee * (r2 - v[0]), ankle = p->d_ankle * (r3 - r2);
    double f1 = b12 * al2 + b13 * al3 - s2 * e12 - s3 * e13
                + GRAVITY * (p->k1_re * kx - p->k1_im * ky) + p->d_hip * v[0] - knee;
    double f2 = p->inertia2 * al2 + b23 * al3 + s1 * e12 - s3 * e23 + GRAVITY * x2 + knee - ankle;
    double f3 = b23 * al2 + p->inertia3 * al3 + s1 * e13 + s2 * e23 + ankle + p->d_slide * r3
                - GRAVITY * x3;
    double n1 = force[0] - f1 - w2h * f2 - w3h * f3 - p->hip_stiffness * (q[0] - p->hip_rest);
    double n2 = force[1] - p->slide_weight - w2s * f2 - w3s * f3
                - p->slide_stiffness * (q[1] - p->slide_rest);
    double determinant = m11 * m22 - m12 * m12;
    a[0] = (m22 * n1 - m12 * n2) / determinant;
    a[1] = (m11 * n2 - m12 * n1) / determinant;
}

static double static_friction(const Friction *f, double v)
{
    double z = v / f->peak;
    double hump = f->stribeck - f->coulomb * tanh(f->peak / f->transition) - f->viscous * f->peak;
    return hump * z * exp(0.5 - 0.5 * z * z) + f->coulomb * tanh(v / f->transition)
           + f->viscous * v;
}

static double gate(const Friction *f, double v)
{
    double z = v / f->edge;
    return -expm1(-z * z);
}

static void semi_implicit(const Model *model, const double *u, double h, double *x)
{
    double force[2] = {u[0] + x[6] - x[4], u[1] + x[7] - x[5]}, a[2];
    accelerate(&model->leg, model->coriolis, x, x + 2, force, a);
    for (int i = 0; i < 2; i++) {
        const Friction *f = &model->friction[i];
        x[i] += h * (x[2 + i] + 0.5 * h * a[i]);
        x[2 + i] += h * a[i];
        double share = -expm1(-gate(f, x[2 + i]) * h / f->time_constant);
        x[4 + i] += share * (static_friction(f, x[2 + i]) - x[4 + i]);
    }
}

static void slope(const Model *model, const double *u, const double *x, double *dx)
{
    double force[2] = {u[0] + x[6] - x[4], u[1] + x[7] - x[5]};
    accelerate(&model->leg, model->coriolis, x, x + 2, force, dx + 2);
    for (int i = 0; i < 2; i++) {
        const Friction *f = &model->friction[i];
        dx[i] = x[2 + i];
        dx[4 + i] = gate(f, x[2 + i]) / f->time_constant * (static_friction(f, x[2 + i]) - x[4 + i]);
        dx[6 + i] = 0.0;
    }
}

static void runge_kutta(const Model *model, const double *u, double h, double *x)
{
    double k1[N], k2[N], k3[N], k4[N], y[N];
    slope(model, u, x, k1);
    for (int i = 0; i < N; i++) y[i] = x[i] + 0.5 * h * k1[i];
    slope(model, u, y, k2);
    for (int i = 0; i < N; i++) y[i] = x[i] + 0.5 * h * k2[i];
    slope(model, u, y, k3);
    for (int i = 0; i < N; i++) y[i] = x[i] + h * k3[i];
    slope(model, u, y, k4);
    for (int i = 0; i < N; i++) x[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
}

/* L lower triangular with L L' = A A', A being rows x columns, by Householder reflections. */
static void triangularise(double *a, int rows, int columns, double *l, int stride)
{
    for (int i = 0; i < rows; i++) {
        double *v = a + i * columns, squares = 0.0;
        for (int k = i; k < columns; k++) squares += v[k] * v[k];
        double length = sqrt(squares), side = copysign(1.0, v[i]);
        double over = squares > 0.0 ? 1.0 / (squares + fabs(v[i]) * length) : 0.0;
        v[i] += side * length;
        l[i * stride + i] = length;
        for (int j = i + 1; j < rows; j++) {
            double *w = a + j * columns, dot = 0.0;
            for (int k = i; k < columns; k++) dot += v[k] * w[k];
            for (int k = i; k < columns; k++) w[k] -= dot * over * v[k];
            l[j * stride + i] = -side * w[i];
            l[i * stride + j] = 0.0;
        }
    }
}

static void predict(const Model *model, int rk4, int substeps, const double *u, double dt,
                    double *mean, double root[N][N])
{
    const double step = sqrt(3.0);
    double points[POINTS][N], a[N][3 * N];
    for (int p = 0; p < POINTS; p++) memcpy(points[p], mean, sizeof points[p]);
    for (int c = 0; c < N; c++)
        for (int r = 0; r < N; r++) {
            points[1 + c][r] += step * root[r][c];
            points[1 + N + c][r] -= step * root[r][c];
        }
    for (int p = 0; p < POINTS; p++)
        for (int s = 0; s < substeps; s++)
            if (rk4)
                runge_kutta(model, u, dt / substeps, points[p]);
            else
                semi_implicit(model, u, dt / substeps, points[p]);
    for (int r = 0; r < N; r++) {
        double sum = 0.0;
        for (int c = 0; c < N; c++) {
            double plus = points[1 + c][r] - points[0][r];
            double minus = points[1 + N + c][r] - points[0][r];
            a[r][c] = (plus - minus) / (2.0 * step);
            a[r][N + c] = sqrt(2.0) / (2.0 * step * step) * (plus + minus);
            a[r][2 * N + c] = r == c ? model->process_std[r] * sqrt(dt / 0.01) : 0.0;
            sum += plus + minus;
        }
        mean[r] = points[0][r] + sum / (2.0 * step * step);
    }
    triangularise(&a[0][0], N, 3 * N, &root[0][0], N);
}

static double correct(const Model *model, const double *z, double *mean, double root[N][N])
{
    double y[M][N + M], s[M][M], k[N][M], a[N][N + M], nu[M], white[M];
    for (int i = 0; i < M; i++) {
        for (int c = 0; c < N; c++) y[i][c] = root[i][c];
        for (int c = 0; c < M; c++) y[i][N + c] = i == c ? model->measurement_std[i] : 0.0;
        nu[i] = z[i] - mean[i];
    }
    triangularise(&y[0][0], M, N + M, &s[0][0], M);
    for (int r = 0; r < N; r++) {
        double p0 = 0.0, p1 = 0.0;
        for (int c = 0; c < N; c++) {
            p0 += root[r][c] * root[0][c];
            p1 += root[r][c] * root[1][c];
        }
        double g0 = p0 / s[0][0], g1 = (p1 - s[1][0] * g0) / s[1][1];
        k[r][1] = g1 / s[1][1];
        k[r][0] = (g0 - s[1][0] * k[r][1]) / s[0][0];
    }
    for (int r = 0; r < N; r++) {
        for (int c = 0; c < N; c++)
            a[r][c] = root[r][c] - k[r][0] * root[0][c] - k[r][1] * root[1][c];
        for (int c = 0; c < M; c++) a[r][N + c] = k[r][c] * model->measurement_std[c];
        mean[r] += k[r][0] * nu[0] + k[r][1] * nu[1];
    }
    triangularise(&a[0][0], N, N + M, &root[0][0], N);
    white[0] = nu[0] / s[0][0];
    white[1] = (nu[1] - s[1][0] * white[0]) / s[1][1];
    return white[0] * white[0] + white[1] * white[1];
}

/* `count` steps; estimates: mean after each, (count, N); nis: (count). */
void anchor_run(const Model *model, int rk4, int substeps, int count, const double *measured,
                const double *effort, double dt, double *mean, double *root, double *estimates,
                double *nis)
{
    double s[N][N];
    memcpy(s, root, sizeof s);
    for (int i = 0; i < count; i++) {
        predict(model, rk4, substeps, effort + M * i, dt, mean, s);
        nis[i] = correct(model, measured + M * i, mean, s);
        memcpy(estimates + N * i, mean, N * sizeof *mean);
    }
    memcpy(root, s, sizeof s);
}
