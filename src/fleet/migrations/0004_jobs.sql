-- Jobs for other lines: a drawing with what belongs to it, which one station of the line takes.

-- The queues that each station takes jobs from. A group of stations shares the queue of one line.
CREATE TABLE isomark.line (
    line text NOT NULL CHECK (char_length(line) BETWEEN 1 AND 100),
    station text NOT NULL REFERENCES isomark.station (name) ON DELETE CASCADE,
    PRIMARY KEY (line, station)
);

CREATE TABLE isomark.job (
    -- A hash of the line, of the drop and of what was sent first: a drop that is offered twice is one job.
    id text COLLATE "C" PRIMARY KEY CHECK (id ~ '^[0-9a-f]{64}$'),
    -- The order in a queue.
    number bigint GENERATED ALWAYS AS IDENTITY UNIQUE,
    line text NOT NULL CHECK (char_length(line) BETWEEN 1 AND 100),
    -- The name of the drawing in the hot folder.
    name text NOT NULL CHECK (char_length(name) BETWEEN 1 AND 255),
    -- The station that sent it, or the login of a person.
    sender text NOT NULL CHECK (char_length(sender) BETWEEN 1 AND 100),
    login name NOT NULL DEFAULT session_user,
    at timestamptz NOT NULL DEFAULT clock_timestamp(),
    bytes bigint NOT NULL CHECK (bytes BETWEEN 0 AND 67108864),
    inputs_blake3 text COLLATE "C" NOT NULL CHECK (inputs_blake3 ~ '^[0-9a-f]{64}$'),
    state text NOT NULL DEFAULT 'waiting' CHECK (state IN ('waiting', 'taken', 'ended')),
    -- How often it was taken. Who finishes it names the number that he took it with.
    attempt integer NOT NULL DEFAULT 0 CHECK (attempt >= 0),
    station text CHECK (char_length(station) BETWEEN 1 AND 100),
    taken timestamptz,
    outcome text CHECK (outcome IN ('delivered', 'uncertain', 'listed', 'removed', 'rejected')),
    reason text CHECK (char_length(reason) <= 2000),
    ended timestamptz,
    CHECK ((state = 'waiting') = (station IS NULL)),
    CHECK ((state = 'ended') = (outcome IS NOT NULL))
);
CREATE INDEX job_waiting ON isomark.job (line, number) WHERE state = 'waiting';
CREATE INDEX job_taken ON isomark.job (station) WHERE state = 'taken';
CREATE INDEX job_ended ON isomark.job (ended) WHERE state = 'ended';

-- What was sent, until the job has ended.
CREATE TABLE isomark.job_inputs (
    job text COLLATE "C" PRIMARY KEY REFERENCES isomark.job (id) ON DELETE CASCADE,
    drawing bytea NOT NULL CHECK (octet_length(drawing) <= 67108864),
    settings bytea CHECK (octet_length(settings) <= 67108864),
    list bytea CHECK (octet_length(list) <= 67108864)
);

-- Fails unless the station's name belongs to this login.
CREATE FUNCTION isomark.check_station(its_name text) RETURNS void
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    IF NOT EXISTS (SELECT FROM isomark.station WHERE name = its_name AND login = session_user) THEN
        RAISE insufficient_privilege USING MESSAGE =
            format('the station name "%s" does not belong to the login "%s"', its_name, session_user);
    END IF;
END $$;

-- Notes from which queues a station takes jobs.
CREATE FUNCTION isomark.serve_lines(its_station text, its_lines text[]) RETURNS void
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    PERFORM isomark.check_station(its_station);
    DELETE FROM isomark.line WHERE station = its_station AND line <> ALL (its_lines);
    INSERT INTO isomark.line (line, station)
        SELECT DISTINCT of_it, its_station FROM unnest(its_lines) AS of_it ON CONFLICT DO NOTHING;
END $$;

-- Puts a job into the queue of a line, once. Gives the hash of what the queue has for it, and whether a station takes from there.
CREATE FUNCTION isomark.offer_job(
    its_id text, its_line text, its_name text, its_station text, its_inputs_blake3 text,
    its_drawing bytea, its_settings bytea, its_list bytea
) RETURNS TABLE (is_new boolean, inputs_blake3 text, state text, is_served boolean)
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
#variable_conflict use_column
DECLARE
    sent isomark.job;
    added boolean;
BEGIN
    IF its_station IS NOT NULL THEN
        PERFORM isomark.check_station(its_station);
    END IF;
    INSERT INTO isomark.job (id, line, name, sender, bytes, inputs_blake3) VALUES (
        its_id, its_line, its_name, coalesce(its_station, session_user),
        octet_length(its_drawing)::int8 + coalesce(octet_length(its_settings), 0) + coalesce(octet_length(its_list), 0),
        its_inputs_blake3
    ) ON CONFLICT (id) DO NOTHING;
    added := FOUND;
    IF added THEN
        INSERT INTO isomark.job_inputs VALUES (its_id, its_drawing, its_settings, its_list);
        PERFORM pg_notify('isomark', 'job ' || its_line);
    END IF;
    SELECT * INTO STRICT sent FROM isomark.job AS j WHERE j.id = its_id;
    RETURN QUERY SELECT added, sent.inputs_blake3, sent.state,
        EXISTS (SELECT FROM isomark.line AS l WHERE l.line = sent.line);
END $$;

-- The next job of the station's queues that no other station is about to take, locked to the end of the transaction.
CREATE FUNCTION isomark.next_job(its_station text, its_busy text[])
RETURNS TABLE (
    id text, attempt integer, line text, name text, sender text, inputs_blake3 text, drawing bytea, settings bytea, list bytea
) LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
#variable_conflict use_column
DECLARE
    of_it text;
    found_id text;
BEGIN
    PERFORM isomark.check_station(its_station);
    FOR of_it IN SELECT l.line FROM isomark.line AS l WHERE l.station = its_station ORDER BY l.line <> its_station, l.line LOOP
        SELECT j.id INTO found_id FROM isomark.job AS j
            WHERE j.line = of_it AND j.state = 'waiting' AND j.id <> ALL (its_busy)
            ORDER BY j.number LIMIT 1 FOR UPDATE SKIP LOCKED;
        IF FOUND THEN
            RETURN QUERY SELECT j.id, least(j.attempt, 2147483646) + 1, j.line, j.name, j.sender, j.inputs_blake3, i.drawing, i.settings, i.list
                FROM isomark.job AS j LEFT JOIN isomark.job_inputs AS i ON i.job = j.id WHERE j.id = found_id;
            RETURN;
        END IF;
    END LOOP;
END $$;

-- Marks a job as taken by a station that has it in its journal. Gives whether it is the station's now.
CREATE FUNCTION isomark.take_job(its_id text, its_station text, its_attempt integer) RETURNS boolean
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    PERFORM isomark.check_station(its_station);
    UPDATE isomark.job SET state = 'taken', station = its_station, attempt = its_attempt, taken = clock_timestamp()
        WHERE id = its_id AND state = 'waiting' AND attempt = its_attempt - 1
        AND line IN (SELECT l.line FROM isomark.line AS l WHERE l.station = its_station);
    RETURN FOUND;
END $$;

-- Notes how a job ended, unless another attempt has begun since. Gives whether it was noted.
CREATE FUNCTION isomark.end_job(its_id text, its_station text, its_attempt integer, its_outcome text, its_reason text)
RETURNS boolean LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    PERFORM isomark.check_station(its_station);
    UPDATE isomark.job SET state = 'ended', outcome = its_outcome, reason = its_reason, ended = clock_timestamp()
        WHERE id = its_id AND state = 'taken' AND station = its_station AND attempt = its_attempt;
    IF NOT FOUND THEN
        -- The answer to the same report may have been lost.
        RETURN EXISTS (SELECT FROM isomark.job WHERE id = its_id AND state = 'ended' AND station = its_station
            AND attempt = its_attempt AND outcome = its_outcome);
    END IF;
    DELETE FROM isomark.job_inputs WHERE job = its_id;
    RETURN true;
END $$;

-- Puts jobs that a station has taken back into a queue: the job with this number at the start, or all of a station with this name.
-- Those of a station that is alive stay, unless it is forced. Who calls this knows that they may have been marked.
CREATE FUNCTION isomark.take_over(its_target text, its_line text, is_forced boolean)
RETURNS TABLE (id text, name text, station text, line text, is_moved boolean)
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
#variable_conflict use_column
DECLARE
    job isomark.job;
    is_alive boolean;
BEGIN
    FOR job IN
        SELECT * FROM isomark.job AS j
        WHERE j.state = 'taken' AND (j.station = its_target OR (its_target ~ '^[0-9a-f]{8,64}$' AND starts_with(j.id, its_target)))
        ORDER BY j.number FOR UPDATE
    LOOP
        SELECT s.runs AND s.beat > now() - interval '45 s' INTO is_alive FROM isomark.station AS s WHERE s.name = job.station;
        IF coalesce(is_alive, false) AND NOT is_forced THEN
            RETURN QUERY SELECT job.id, job.name, job.station, job.line, false;
            CONTINUE;
        END IF;
        UPDATE isomark.job AS j SET state = 'waiting', station = NULL, taken = NULL, line = coalesce(its_line, j.line)
            WHERE j.id = job.id;
        PERFORM pg_notify('isomark', 'job ' || coalesce(its_line, job.line));
        RETURN QUERY SELECT job.id, job.name, job.station, coalesce(its_line, job.line), true;
    END LOOP;
END $$;
