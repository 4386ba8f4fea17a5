"""Contact estimator in space in about a hundred lines: a bank of extended Kalman filters for a contact that moves at random.

    whisker evaluate datasets/spatial --exec "python examples/my_filter_space.py"

Two bending moments do not determine a contact with three coordinates: a light push near the tip and a firm one near the root give
the same reading. Each touch therefore begins with one hypothesis per calibrated arc length that explains the reading. Each
hypothesis is a Kalman filter, weighted by its marginal likelihood. `docs/your-estimator.md` specifies the lines that are read and
written, version 2.
"""

import json
import sys

import numpy as np

PROCESS_SD_M = 4e-6  # standard deviation of the contact's random walk per row
SLIDING = 0.3  # the same in addition, as a share of the way of the base, because a contact slides over its object
LEAST_WEIGHT = 1e-15  # hypotheses with smaller weights are discarded
AXES = ("x", "y", "z")
ANSWER = (*(f"contact_{axis}_m" for axis in AXES), *(f"cov_{pair}_m2" for pair in ("xx", "xy", "xz", "yy", "yz", "zz")))


class Sensor:
    """Sensor model of a whisker, from its table of n nodes."""

    def __init__(self, known: dict):
        table = {name: np.array(column) for name, column in known["table"].items()}
        self.shape = known["shape"]
        self.places_m = np.stack([table[f"{axis}_m"] for axis in AXES], axis=-1)
        self.readings_n_m = np.stack([table["moment_y_n_m"], table["moment_z_n_m"]], axis=-1)
        gradients = [[table[f"moment_{moment}_by_{axis}_n"] for axis in AXES] for moment in ("y", "z")]
        self.gradients_n = np.moveaxis(np.array(gradients), -1, 0)
        yy, yz, zz = (table[f"model_cov_{pair}_n2_m2"] for pair in ("yy", "yz", "zz"))
        self.errors_n2_m2 = np.moveaxis(np.array([[yy, yz], [yz, zz]]), -1, 0)

    def expect(self, contacts_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Predicted moments (k, 2), their gradients (k, 2, 3) and the model's covariances (k, 2, 2) at contacts (k, 3) in Base.

        Linear about the nearest node.
        """
        offsets_m = contacts_m[:, None] - self.places_m
        node = np.argmin((offsets_m**2).sum(axis=-1), axis=1)
        offset_m, gradient_n = offsets_m[np.arange(len(node)), node], self.gradients_n[node]
        moments_n_m = self.readings_n_m[node] + np.einsum("kij,kj->ki", gradient_n, offset_m)
        return moments_n_m, gradient_n, self.errors_n2_m2[node]

    def hypotheses(self, reading_n_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Contacts (k, 3) in Base that explain a reading (2,), one per arc length, and their covariances (k, 3, 3).

        The standard deviation of each extends to the next contact.
        """
        off_n_m = np.linalg.norm(self.readings_n_m - reading_n_m, axis=-1).reshape(self.shape[0], -1)
        node = np.arange(self.shape[0]) * off_n_m.shape[1] + np.argmin(off_n_m, axis=1)
        step_m = np.linalg.pinv(self.gradients_n[node]) @ (reading_n_m - self.readings_n_m[node])[:, :, None]
        contacts_m = self.places_m[node] + step_m[:, :, 0]
        along_m = np.gradient(contacts_m, axis=0)
        return contacts_m, along_m[:, :, None] * along_m[:, None]


class Bank:
    """Kalman filters for the contact in the frame of the first row, weighted by their marginal likelihoods."""

    def __init__(self, sensor: Sensor, row: dict, noise_sd_n_m: float):
        self.sensor, self.noise_n2_m2 = sensor, noise_sd_n_m**2 * np.eye(2)
        contacts_m, covariances_m2 = sensor.hypotheses(reading(row))
        origin_m, turn = base(row)
        self.means_m = contacts_m @ turn.T + origin_m
        self.covariances_m2 = turn @ covariances_m2 @ turn.T + 1e-5**2 * np.eye(3)
        self.log_weights = np.zeros(len(contacts_m))

    def step(self, row: dict) -> dict:
        """Processes a row; returns the estimate of the contact in Base."""
        origin_m, turn = base(row)
        way_m = np.linalg.norm([row[f"last_{axis}_m"] for axis in AXES])
        self.covariances_m2 += (PROCESS_SD_M**2 + (SLIDING * way_m) ** 2) * np.eye(3)
        expected_n_m, gradients_n, errors_n2_m2 = self.sensor.expect((self.means_m - origin_m) @ turn)
        gradients_n = gradients_n @ turn.T
        spread = self.covariances_m2 @ np.swapaxes(gradients_n, 1, 2)
        covariance_n2_m2 = gradients_n @ spread + self.noise_n2_m2 + errors_n2_m2
        residual_n_m = reading(row) - expected_n_m

        gains = np.swapaxes(np.linalg.solve(covariance_n2_m2, np.swapaxes(spread, 1, 2)), 1, 2)
        self.means_m += np.einsum("kij,kj->ki", gains, residual_n_m)
        self.covariances_m2 -= gains @ np.swapaxes(spread, 1, 2)
        whitened = np.linalg.solve(covariance_n2_m2, residual_n_m[:, :, None])[:, :, 0]
        self.log_weights -= 0.5 * ((residual_n_m * whitened).sum(axis=-1) + np.linalg.slogdet(covariance_n2_m2)[1])
        keep = self.weights() > LEAST_WEIGHT
        self.means_m, self.covariances_m2 = self.means_m[keep], self.covariances_m2[keep]
        self.log_weights = self.log_weights[keep]

        weights = self.weights()
        mean_m = weights @ self.means_m
        offsets_m = self.means_m - mean_m
        spread_m2 = np.tensordot(weights, self.covariances_m2 + offsets_m[:, :, None] * offsets_m[:, None], axes=1)
        contact_m, spread_m2 = turn.T @ (mean_m - origin_m), turn.T @ spread_m2 @ turn
        answer = [*contact_m, *spread_m2[np.triu_indices(3)]]
        return dict(zip(ANSWER, map(float, answer), strict=True))

    def weights(self) -> np.ndarray:
        """Probabilities of the hypotheses (k,)."""
        weights = np.exp(self.log_weights - self.log_weights.max())
        return weights / weights.sum()


def reading(row: dict) -> np.ndarray:
    """Bending moments about y and z of Base (2,)."""
    return np.array([row["moment_y_n_m"], row["moment_z_n_m"]])


def base(row: dict) -> tuple[np.ndarray, np.ndarray]:
    """Origin (3,) and rotation (3, 3) of Base in the frame of the first row."""
    w, x, y, z = (row[f"base_q{part}"] for part in ("w", "x", "y", "z"))
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return np.array([row[f"base_{axis}_m"] for axis in AXES]), turn


def main() -> None:
    """Answers each row with one line."""
    known = json.loads(sys.stdin.readline())
    if known["protocol"] != 2:
        sys.exit(f"protocol: found {known['protocol']}, expected 2: an evaluation of traces in space")
    sensor, bank = Sensor(known), None
    for line in sys.stdin:
        row = json.loads(line)
        if not row["touched"]:
            bank = None
        elif bank is None:
            bank = Bank(sensor, row, known["noise_sd_n_m"])
        print(json.dumps(bank and bank.step(row)), flush=True)


if __name__ == "__main__":
    main()
