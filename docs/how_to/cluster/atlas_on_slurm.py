"""Build a map on a SLURM cluster; run it where jobs are submitted, and leave it running."""

from dask_jobqueue import SLURMCluster

from baxter_kin.parallel.dask_cluster import DaskCluster
from planner.atlas import build_reach_map

JOBS = 40

EACH_JOB = {
    "cores": 1,
    "processes": 1,
    "memory": "1GB",
    "walltime": "04:00:00",
    "job_name": "baxter-atlas",
    "python": "/shared/baxter-kin/.venv/bin/python",
    "log_directory": "logs",
    "local_directory": "/tmp",
}


def main() -> None:
    """Submit the jobs, build with those that run, and end them."""
    with SLURMCluster(**EACH_JOB) as cluster, cluster.get_client() as client:
        cluster.scale(jobs=JOBS)
        client.wait_for_workers(1)
        build_reach_map("/shared/maps/reach.zarr", engine=DaskCluster(client))


if __name__ == "__main__":
    main()
