/* The running sums x, z, xx, xz, zz, one row each: what every detection of changepoints must do. */
void five_sums(const double *restrict x, const double *restrict z, double *restrict sums, long count)
{
    double sx = 0.0, sz = 0.0, sxx = 0.0, sxz = 0.0, szz = 0.0;
    for (long k = 0; k < count; ++k) {
        const double u = x[k], v = z[k];
        sums[k] = sx += u;
        sums[count + k] = sz += v;
        sums[2 * count + k] = sxx += u * u;
        sums[3 * count + k] = sxz += u * v;
        sums[4 * count + k] = szz += v * v;
    }
}
