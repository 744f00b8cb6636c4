"""What `init` writes beside the keys of a vehicle's own tables in campaign.toml."""

from __future__ import annotations

COMMENTS: dict[str, dict[str, str]] = {
    "trajectory": {
        "harmonics": "N of thesis (3.3)",
        "duration": "s of each flight",
        "omega0": 'rad/s, or "none" for one period in the duration',
        "start": '"moving", with the plan\'s velocity, or "hover", at rest, as the thesis',
        "rest": "whether the plan itself starts and ends at rest",
        "free_centre": "whether x and y have a constant term too",
        "tilt": "rad, largest angle of the planned thrust from the vertical, if the vehicle's is not less",
        "lean": "whether simulated flights lean against the drag that earlier ones taught",
        "centre": "m, constant terms of x and y where they are not free; of a room without 0, 0 its middle",
    },
    "data": {
        "averaged": "means over each sample interval; false: single samples, as the thesis",
        "lag_s": 's that the motion lags behind the commands; "auto" measures it',
        "first_s": "s cut from the start of a flight",
        "last_s": "s cut from its end",
        "altitude": "whether the altitude is an input",
        "acceleration": '"specific_force", or "kinematic", as the thesis',
        "body_velocity": "whether the velocity is an input; drag depends on it",
        "battery_voltage": "whether the voltage may be an input; it is where flights held out gain",
        "trims": "whether the identified physics have a constant for each motor",
    },
}
