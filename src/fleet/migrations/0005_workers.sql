-- Workers without a laser, and the fits that stations ask them for.

CREATE TABLE isomark.worker (
    -- One run of the program.
    process text COLLATE "C" PRIMARY KEY CHECK (char_length(process) BETWEEN 1 AND 64),
    name text NOT NULL CHECK (char_length(name) BETWEEN 1 AND 100),
    login name NOT NULL,
    program text NOT NULL CHECK (char_length(program) BETWEEN 1 AND 100),
    -- Program and version of its fits: only what asks for the same is for it.
    maker text NOT NULL CHECK (char_length(maker) BETWEEN 1 AND 200),
    since timestamptz NOT NULL,
    beat timestamptz NOT NULL,
    made bigint NOT NULL CHECK (made >= 0),
    failed bigint NOT NULL CHECK (failed >= 0)
);

-- The fits that stations wait for. A row is removed when no station waits for it any more.
CREATE TABLE isomark.fit_request (
    -- The key of the surface in the cache of a station.
    key text COLLATE "C" PRIMARY KEY CHECK (key ~ '^[0-9a-f]{32}$'),
    -- The order in which they are taken.
    number bigint GENERATED ALWAYS AS IDENTITY,
    maker text NOT NULL CHECK (char_length(maker) BETWEEN 1 AND 200),
    sku text NOT NULL CHECK (char_length(sku) BETWEEN 1 AND 200),
    -- The hash of the part.
    part text COLLATE "C" NOT NULL CHECK (part ~ '^[0-9a-f]{64}$'),
    -- The part with everything that its fit depends on; NULL when it has ended.
    task bytea CHECK (octet_length(task) <= 67108864),
    task_blake3 text COLLATE "C" NOT NULL CHECK (task_blake3 ~ '^[0-9a-f]{64}$'),
    state text NOT NULL DEFAULT 'waiting' CHECK (state IN ('waiting', 'taken', 'made', 'failed')),
    -- Counts over all requests, and grows whenever one is asked for, taken or given back. Who finishes it names the number that he took
    -- it with, so that he changes nothing after it was taken from him, also if it was asked for again since.
    attempt bigint NOT NULL,
    worker text COLLATE "C" CHECK (char_length(worker) BETWEEN 1 AND 64),
    -- Until when its worker is expected to give the next sign of life.
    lease timestamptz,
    reason text CHECK (char_length(reason) <= 2000),
    at timestamptz NOT NULL DEFAULT clock_timestamp(),
    CHECK ((state = 'waiting') = (worker IS NULL)),
    CHECK ((worker IS NULL) = (lease IS NULL))
);
ALTER TABLE isomark.fit_request ALTER COLUMN task SET STORAGE EXTERNAL;
CREATE INDEX fit_request_waiting ON isomark.fit_request (maker, number) WHERE state = 'waiting';
CREATE SEQUENCE isomark.fit_attempt;

-- The stations that wait for a fit.
CREATE TABLE isomark.fit_asker (
    key text COLLATE "C" NOT NULL REFERENCES isomark.fit_request (key) ON DELETE CASCADE,
    station text NOT NULL CHECK (char_length(station) BETWEEN 1 AND 100),
    PRIMARY KEY (key, station)
);

-- Joins the stations that wait for a fit. Gives 'there' if the fleet has it, 'asked' if another station waits for it already, 'none'
-- if no worker would take it, and otherwise 'ask'.
CREATE FUNCTION isomark.join_fit(its_key text, its_station text, its_maker text) RETURNS text
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    PERFORM isomark.check_station(its_station);
    -- Of stations that died while they waited.
    DELETE FROM isomark.fit_request WHERE at < now() - interval '10 min';
    IF EXISTS (SELECT FROM isomark.fit WHERE key = its_key) THEN
        RETURN 'there';
    END IF;
    PERFORM FROM isomark.fit_request
        WHERE key = its_key AND maker = its_maker AND (state = 'waiting' OR (state = 'taken' AND lease >= now())) FOR UPDATE;
    IF FOUND THEN
        INSERT INTO isomark.fit_asker VALUES (its_key, its_station) ON CONFLICT DO NOTHING;
        RETURN 'asked';
    END IF;
    IF NOT EXISTS (SELECT FROM isomark.worker WHERE maker = its_maker AND beat > now() - interval '30 s') THEN
        RETURN 'none';
    END IF;
    RETURN 'ask';
END $$;

-- Asks workers for a fit. If another station asked for it meanwhile, both wait for the same.
CREATE FUNCTION isomark.ask_for_fit(
    its_key text, its_station text, its_maker text, its_sku text, its_part text, its_task bytea, its_task_blake3 text
) RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    PERFORM isomark.check_station(its_station);
    -- What has ended, or was asked for by another version of the program, is of no use to this station.
    DELETE FROM isomark.fit_request
        WHERE key = its_key AND (state IN ('made', 'failed') OR maker <> its_maker OR lease < now());
    INSERT INTO isomark.fit_request (key, maker, sku, part, task, task_blake3, attempt)
        VALUES (its_key, its_maker, its_sku, its_part, its_task, its_task_blake3, nextval('isomark.fit_attempt'))
        ON CONFLICT (key) DO NOTHING;
    INSERT INTO isomark.fit_asker VALUES (its_key, its_station) ON CONFLICT DO NOTHING;
    PERFORM pg_notify('isomark_work', '');
END $$;

-- A station does not wait for a fit any more. If no other one does, or its worker is late, its attempt ends: what the worker sends
-- later changes nothing.
CREATE FUNCTION isomark.leave_fit(its_key text, its_station text) RETURNS void
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    PERFORM isomark.check_station(its_station);
    PERFORM FROM isomark.fit_request WHERE key = its_key FOR UPDATE;
    DELETE FROM isomark.fit_asker WHERE key = its_key AND station = its_station;
    DELETE FROM isomark.fit_request AS r WHERE r.key = its_key
        AND (NOT EXISTS (SELECT FROM isomark.fit_asker AS a WHERE a.key = its_key) OR (r.state = 'taken' AND r.lease < now()));
    IF FOUND THEN
        -- Other stations that wait for a late worker.
        PERFORM pg_notify('isomark', 'request ' || its_key);
    END IF;
END $$;

-- Fails unless the worker belongs to this login.
CREATE FUNCTION isomark.check_worker(its_process text) RETURNS void
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    IF NOT EXISTS (SELECT FROM isomark.worker WHERE process = its_process AND login = session_user) THEN
        RAISE insufficient_privilege USING MESSAGE =
            format('the worker "%s" does not belong to the login "%s"', its_process, session_user);
    END IF;
END $$;

-- Notes that a worker is alive, or that it ends.
CREATE FUNCTION isomark.beat_of_worker(
    its_process text, its_name text, its_program text, its_maker text, it_runs boolean, its_made bigint, its_failed bigint
) RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    -- Of workers that died.
    DELETE FROM isomark.worker WHERE beat < now() - interval '1 day';
    INSERT INTO isomark.worker VALUES (
        its_process, its_name, session_user, its_program, its_maker, now(), now(), its_made, its_failed
    ) ON CONFLICT (process) DO NOTHING;
    PERFORM isomark.check_worker(its_process);
    IF it_runs THEN
        UPDATE isomark.worker SET beat = now(), made = its_made, failed = its_failed WHERE process = its_process;
    ELSE
        DELETE FROM isomark.worker WHERE process = its_process;
    END IF;
END $$;

-- Takes the next request that no other worker is about to take. The lease also covers the time for the task over a slow network.
CREATE FUNCTION isomark.take_request(its_process text)
RETURNS TABLE (key text, attempt bigint, sku text, part text, task_blake3 text)
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
#variable_conflict use_column
DECLARE
    found_key text;
    its_maker text;
BEGIN
    PERFORM isomark.check_worker(its_process);
    SELECT w.maker INTO STRICT its_maker FROM isomark.worker AS w WHERE w.process = its_process;
    SELECT r.key INTO found_key FROM isomark.fit_request AS r
        WHERE r.state = 'waiting' AND r.maker = its_maker ORDER BY r.number LIMIT 1 FOR UPDATE SKIP LOCKED;
    IF NOT FOUND THEN
        RETURN;
    END IF;
    PERFORM pg_notify('isomark', 'request ' || found_key);
    RETURN QUERY UPDATE isomark.fit_request AS r SET
        state = 'taken', worker = its_process, attempt = nextval('isomark.fit_attempt'),
        lease = now() + make_interval(secs => 10 + least(octet_length(r.task), 67108864) / 4e6)
    WHERE r.key = found_key RETURNING r.key, r.attempt, r.sku, r.part, r.task_blake3;
END $$;

-- A worker gives a sign of life. Gives whether the request is still its own.
CREATE FUNCTION isomark.keep_request(its_key text, its_process text, its_attempt bigint) RETURNS boolean
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    PERFORM isomark.check_worker(its_process);
    UPDATE isomark.fit_request SET lease = greatest(lease, now() + interval '10 s')
        WHERE key = its_key AND worker = its_process AND attempt = its_attempt AND state = 'taken';
    RETURN FOUND;
END $$;

-- A worker has made a fit, which it adds in the same transaction, or gives the reason why it cannot. Gives whether the request is
-- still its own; if not, nothing was changed, and the fit must not be added.
CREATE FUNCTION isomark.end_request(its_key text, its_process text, its_attempt bigint, its_reason text) RETURNS boolean
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    PERFORM isomark.check_worker(its_process);
    UPDATE isomark.fit_request SET
        state = CASE WHEN its_reason IS NULL THEN 'made' ELSE 'failed' END, reason = its_reason, task = NULL
        WHERE key = its_key AND worker = its_process AND attempt = its_attempt AND state = 'taken';
    IF FOUND THEN
        PERFORM pg_notify('isomark', 'request ' || its_key);
        RETURN true;
    END IF;
    RETURN false;
END $$;

-- A worker that ends gives its request back to the others.
CREATE FUNCTION isomark.return_request(its_key text, its_process text, its_attempt bigint) RETURNS boolean
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    PERFORM isomark.check_worker(its_process);
    UPDATE isomark.fit_request SET
        state = 'waiting', worker = NULL, lease = NULL, attempt = nextval('isomark.fit_attempt')
        WHERE key = its_key AND worker = its_process AND attempt = its_attempt AND state = 'taken';
    IF FOUND THEN
        PERFORM pg_notify('isomark', 'request ' || its_key);
        PERFORM pg_notify('isomark_work', '');
        RETURN true;
    END IF;
    RETURN false;
END $$;
