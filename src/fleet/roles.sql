-- The roles of a fleet, each with the least rights that it needs. `isomark fleet init` runs this after the migrations, every
-- time. A login gets its rights with `GRANT isomark_station TO laser1`.

DO $$
DECLARE
    role text;
BEGIN
    FOREACH role IN ARRAY ARRAY['isomark_station', 'isomark_worker', 'isomark_office', 'isomark_viewer'] LOOP
        IF NOT EXISTS (SELECT FROM pg_catalog.pg_roles WHERE rolname = role) THEN
            BEGIN
                EXECUTE format('CREATE ROLE %I NOLOGIN', role);
            EXCEPTION WHEN duplicate_object OR unique_violation THEN
                NULL; -- Another database of the same server is being set up at this moment.
            END;
        END IF;
    END LOOP;
END $$;

REVOKE ALL ON SCHEMA isomark FROM PUBLIC;
REVOKE ALL ON ALL TABLES IN SCHEMA isomark FROM PUBLIC, isomark_station, isomark_worker, isomark_office, isomark_viewer;
REVOKE ALL ON ALL FUNCTIONS IN SCHEMA isomark FROM PUBLIC, isomark_station, isomark_worker, isomark_office, isomark_viewer;
GRANT USAGE ON SCHEMA isomark TO isomark_station, isomark_worker, isomark_office, isomark_viewer;

-- Everybody sees the stations and the version of the tables.
GRANT SELECT ON isomark.migration, isomark.station TO isomark_station, isomark_worker, isomark_office, isomark_viewer;
GRANT EXECUTE ON FUNCTION
    isomark.beat(text, text, text, boolean, bigint, bigint, bigint, bigint, bigint, bigint, text)
    TO isomark_station, isomark_worker;

-- Everybody sees which part is the current one. Bodies of fits are for those that use them; a fit is written once.
GRANT SELECT ON isomark.current_part, isomark.part_version TO isomark_station, isomark_worker, isomark_office, isomark_viewer;
GRANT SELECT (key, sku, part, bytes, station, login, at, used) ON isomark.fit TO isomark_office, isomark_viewer;
GRANT SELECT, INSERT (key, sku, part, body, body_blake3, mesh, mesh_blake3, station), UPDATE (used)
    ON isomark.fit TO isomark_station, isomark_worker;
GRANT DELETE ON isomark.fit TO isomark_office;
GRANT EXECUTE ON FUNCTION isomark.learned(text, text, text, text, boolean, text, float8) TO isomark_station, isomark_office;

-- Everybody sees what was released and which station has it. The settings themselves are for stations and the office; only the
-- office releases them.
GRANT SELECT ON isomark.current_release, isomark.station_release
    TO isomark_station, isomark_worker, isomark_office, isomark_viewer;
GRANT SELECT (sku, version, name, station, blake3, author, login, at) ON isomark.release TO isomark_worker, isomark_viewer;
GRANT SELECT ON isomark.release TO isomark_station, isomark_office;
GRANT EXECUTE ON FUNCTION isomark.release(text, text, text, bytea, text, text) TO isomark_office;
GRANT EXECUTE ON FUNCTION isomark.received(text, text[], bigint[], text[], text[]) TO isomark_station;
-- Everybody sees the jobs for other lines, without what was sent. Stations and the office send them; stations take them; people at
-- both take over what a station had taken.
GRANT SELECT ON isomark.job, isomark.line TO isomark_station, isomark_worker, isomark_office, isomark_viewer;
GRANT EXECUTE ON FUNCTION isomark.offer_job(text, text, text, text, text, bytea, bytea, bytea), isomark.take_over(text, text, boolean)
    TO isomark_station, isomark_office;
GRANT EXECUTE ON FUNCTION
    isomark.serve_lines(text, text[]), isomark.next_job(text, text[]), isomark.take_job(text, text, integer),
    isomark.end_job(text, text, integer, text, text)
    TO isomark_station;
GRANT DELETE ON isomark.job TO isomark_office;
GRANT EXECUTE ON FUNCTION isomark.forget_station(text) TO isomark_office;
-- Everybody sees the workers, and which fits stations wait for. Stations ask for fits; only workers read the parts and end requests.
GRANT SELECT ON isomark.worker, isomark.fit_asker TO isomark_station, isomark_worker, isomark_office, isomark_viewer;
GRANT SELECT (key, number, maker, sku, part, state, attempt, worker, lease, reason, at) ON isomark.fit_request
    TO isomark_station, isomark_office, isomark_viewer;
GRANT SELECT ON isomark.fit_request TO isomark_worker;
GRANT EXECUTE ON FUNCTION
    isomark.join_fit(text, text, text), isomark.ask_for_fit(text, text, text, text, text, bytea, text),
    isomark.leave_fit(text, text)
    TO isomark_station;
GRANT EXECUTE ON FUNCTION
    isomark.beat_of_worker(text, text, text, text, boolean, bigint, bigint), isomark.take_request(text),
    isomark.keep_request(text, text, bigint), isomark.end_request(text, text, bigint, text),
    isomark.return_request(text, text, bigint)
    TO isomark_worker;
