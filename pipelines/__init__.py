"""Pipeline files that come with o3dls; installed as `o3dls.pipelines`."""
