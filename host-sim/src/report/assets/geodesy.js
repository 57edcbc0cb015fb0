// Longitude and latitude of a local point: east-north-up to earth-centred to geodetic, on WGS84.

const WGS84_A_M = 6378137;
const WGS84_E2 = 0.00669437999014;

/** Geodetic position of the ground point (e, n) over the tangent plane at the origin, degrees. */
function lonLatOf(e_m, n_m, origin_deg) {
  const [lon, lat] = origin_deg.map((x) => (x * Math.PI) / 180);
  const [sinLon, cosLon, sinLat, cosLat] = [Math.sin(lon), Math.cos(lon), Math.sin(lat), Math.cos(lat)];
  const normal_m = WGS84_A_M / Math.sqrt(1 - WGS84_E2 * sinLat ** 2);
  const x_m = normal_m * cosLat * cosLon - sinLon * e_m - sinLat * cosLon * n_m;
  const y_m = normal_m * cosLat * sinLon + cosLon * e_m - sinLat * sinLon * n_m;
  const z_m = normal_m * (1 - WGS84_E2) * sinLat + cosLat * n_m;
  return [Math.atan2(y_m, x_m), latitude(Math.hypot(x_m, y_m), z_m)].map((x) => (x * 180) / Math.PI);
}

/** Bowring's one step: exact to far below a millimetre near the ground. */
function latitude(axis_m, z_m) {
  const b_m = WGS84_A_M * Math.sqrt(1 - WGS84_E2);
  const reduced = Math.atan2(z_m * WGS84_A_M, axis_m * b_m);
  const ep2 = WGS84_E2 / (1 - WGS84_E2);
  return Math.atan2(
    z_m + ep2 * b_m * Math.sin(reduced) ** 3,
    axis_m - WGS84_E2 * WGS84_A_M * Math.cos(reduced) ** 3,
  );
}

function formatLonLat([lon_deg, lat_deg]) {
  const north = `${Math.abs(lat_deg).toFixed(5)}° ${lat_deg < 0 ? "S" : "N"}`;
  return `${north}, ${Math.abs(lon_deg).toFixed(5)}° ${lon_deg < 0 ? "W" : "E"}`;
}
