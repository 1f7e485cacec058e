!> Record of a run in its result file: origin, input, outcome of each point, and damaged rows: each row has a checksum
!> over its values in most datasets. Read by one process; `resume` and `info` begin with it.
module hb_results_record
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_advice, only: advice_list_t
   use hb_attempts, only: row_of
   use hb_checksum, only: checksum_rows
   use hb_error, only: annotate, error_t, fail
   use hb_file_location, only: check_source
   use hb_hdf5, only: h5_dataset_t, h5_file_t, open_file
   use hb_kinds, only: int64, wp
   use hb_motion_columns, only: max_advice, max_attempts, max_values
   use hb_operating_system, only: file_kind, kind_of_file
   use hb_outcome, only: is_solved, is_status, outcome, outcome_names
   use hb_parameter_path, only: identifier
   use hb_results_file, only: schema_version
   use hb_solver_types, only: attempt_t, fallback_names
   use hb_stored_rows, only: stored_file_t
   use hb_sweep_plan, only: sweep_plan_t
   use hb_text, only: join, number_of, split, string_t, texts_t, to_text
   implicit none
   private
   public :: advice_of, attempts_of, count_pending, fail_where_damaged, message_of, messages_of, name_of_input, numbers_of
   public :: open_points
   public :: store_law_findings
   public :: read_record, read_units, record_t, reject_damaged_rows

   type :: record_t
      character(:), allocatable :: title, program_version, git_commit, created_utc
      character(:), allocatable :: law_findings            !! what is wrong with user laws, if a run found anything
      integer :: n_ranks = 0                            !! of the run that created the file
      integer :: n_points = 0
      logical :: is_census = .false.                    !! the points are the motions of a census
      character(:), allocatable :: input_name           !! name of the input file, for messages
      character(:), allocatable :: input_folder         !! folder of files that it names; empty if unknown
      character(:), allocatable :: input_text           !! the input as given
      type(string_t), allocatable :: overrides(:)       !! path=value
      character(:), allocatable :: input_complete       !! the input after defaults
      character(:), allocatable :: input_libraries      !! of laws of the user, with their checksums, one per line
      integer, allocatable :: tuples(:, :)              !! (n_tones, n_harmonics); zeros if points have their own
      logical :: has_own_tuples = .false.               !! points have their own tuples
      character(:), allocatable :: dofs(:), laws(:)     !! labels
      integer, allocatable :: status(:)                 !! (n_points), hb_outcome; as the next
      integer, allocatable :: fallback(:)
      integer, allocatable :: is_near_commensurate(:)
      integer, allocatable :: is_stable(:)              !! 1 stable, -1 unstable, 0 not known
      integer, allocatable :: stability_reason(:)       !! why it is not known, unknown_because; 0: known, or not stored
      integer, allocatable :: branch(:)                 !! hb_branches; 0: unknown
      real(wp), allocatable :: frequency(:, :)          !! [rad/s], (n_tones, n_points)
      real(wp), allocatable :: residual(:)
      real(wp), allocatable :: solve_seconds(:)         !! [s]; NaN for a point not solved, as the next
      real(wp), allocatable :: truncation(:), aliasing(:)
      real(wp), allocatable :: of_frequency(:)          !! largest error of an unknown tone, relative; not allocated: not stored
      real(wp), allocatable :: by_levels(:)             !! from the difference of levels; not allocated: none were refined
      real(wp), allocatable :: penetration(:)           !! [m]
      logical, allocatable :: is_damaged(:)             !! according to checksums; not allocated before `check_rows`
   contains
      procedure :: check_rows => record_check_rows
      procedure :: has_tuples => record_has_tuples
   end type record_t

contains

   !> Name of the input of a file in the folder of its run, to which files that it names are relative.
   function name_of_input(record) result(name)
      type(record_t), intent(in) :: record
      character(len(record%input_folder) + len(record%input_name)) :: name   !! padded with blanks

      name = record%input_name
      if (kind_of_file(record%input_folder) == file_kind%folder) &
         name = record%input_folder//record%input_name(index(record%input_name, "/", back=.true.) + 1:)
   end function name_of_input

   !> Reads the message of a point; empty if there is none or it cannot be read.
   function message_of(path, point) result(message)
      character(*), intent(in) :: path                  !! of the result file
      integer, intent(in) :: point                      !! from 1
      character(:), allocatable :: message
      type(string_t), allocatable :: messages(:)

      call messages_of(path, [point], messages)
      message = messages(1)%value
   end function message_of

   !> Reads the messages of points, likewise.
   subroutine messages_of(path, points, messages)
      character(*), intent(in) :: path                  !! of the result file
      integer, intent(in) :: points(:)                  !! from 1
      type(string_t), allocatable, intent(out) :: messages(:)
      type(error_t), allocatable :: error
      type(h5_dataset_t) :: dataset
      type(h5_file_t) :: file
      integer :: i

      allocate (messages(size(points)))
      do i = 1, size(points)
         messages(i)%value = ""
      end do
      call open_file(file, path, error)
      if (.not. allocated(error)) call file%open_dataset("message", dataset, error)
      do i = 1, size(points)
         if (allocated(error)) exit
         call dataset%read_text_row(points(i), messages(i)%value, error)
      end do
      call file%close(error)
   end subroutine messages_of

   !> Reads the advice on points that have no motion, without words; none if it cannot be read.
   subroutine advice_of(path, points, lists)
      character(*), intent(in) :: path                  !! of the result file
      integer, intent(in) :: points(:)                  !! from 1
      type(advice_list_t), intent(out) :: lists(:)      !! as points
      type(error_t), allocatable :: error
      type(h5_dataset_t) :: numbers_of_rows, values_of_rows
      type(h5_file_t) :: file
      real(wp) :: values(max_values, max_advice)
      integer :: i, k, numbers(max_advice)

      call open_file(file, path, error)
      if (.not. allocated(error)) call file%open_dataset("advice_values", values_of_rows, error)
      if (.not. allocated(error)) call file%open_dataset("advice", numbers_of_rows, error)
      do k = 1, size(points)
         if (.not. allocated(error)) call values_of_rows%read(values, error, first=points(k))
         if (.not. allocated(error)) call numbers_of_rows%read(numbers, error, first=points(k))
         if (allocated(error)) exit
         do i = 1, count(numbers > 0)
            call lists(k)%add(numbers(i), pack(values(:, i), ieee_is_finite(values(:, i))))
         end do
      end do
      call values_of_rows%close()
      call numbers_of_rows%close()
      call file%close(error)
   end subroutine advice_of

   !> Reads the attempts of a point; none if they cannot be read. Their numbers are those of the program that wrote the file,
   !> which names them there.
   subroutine attempts_of(path, point, attempts)
      character(*), intent(in) :: path                  !! of the result file
      integer, intent(in) :: point                      !! from 1
      type(attempt_t), allocatable, intent(out) :: attempts(:)
      type(error_t), allocatable :: error
      type(h5_dataset_t) :: dataset
      type(h5_file_t) :: file
      type(string_t), allocatable :: names(:)
      character(:), allocatable :: meanings
      real(wp) :: least(max_attempts)
      integer :: depth(max_attempts), i, numbers(max_attempts), statuses(max_attempts)

      allocate (attempts(0))
      call open_file(file, path, error)
      numbers = 0
      call read_row("attempt_status", statuses)
      call read_row("attempt_depth", depth)
      if (.not. allocated(error)) call file%open_dataset("attempt_residual", dataset, error)
      if (.not. allocated(error)) call dataset%read(least, error, first=point)
      call dataset%close()
      call read_row("attempts", numbers, meanings)
      if (.not. allocated(error)) then
         call split(meanings, " ", names)
         do i = 1, count(numbers > 0 .and. numbers < size(names))
            attempts = [attempts, attempt_t(rule=row_of(names(numbers(i) + 1)%value), status=statuses(i), depth=depth(i))]
            if (ieee_is_finite(least(i))) attempts(i)%best = least(i)
         end do
         attempts = pack(attempts, attempts%rule > 0)
      end if
      call file%close(error)

   contains

      subroutine read_row(name, values, meanings)
         character(*), intent(in) :: name
         integer, intent(out) :: values(:)
         character(:), allocatable, intent(out), optional :: meanings   !! of its values, one word each

         if (.not. allocated(error)) call file%open_dataset(name, dataset, error)
         if (.not. allocated(error)) call dataset%read(values, error, first=point)
         if (.not. allocated(error) .and. present(meanings)) call dataset%get_attribute("flag_meanings", meanings, error)
         call dataset%close()
      end subroutine read_row
   end subroutine attempts_of

   !> Reads a column of whole numbers, such as the statuses of all points; none if it cannot be read.
   function numbers_of(path, name) result(numbers)
      character(*), intent(in) :: path                  !! of the result file
      character(*), intent(in) :: name                  !! of the column
      integer, allocatable :: numbers(:)
      type(error_t), allocatable :: error
      type(h5_file_t) :: file

      call open_file(file, path, error)
      if (.not. allocated(error)) call file%get(name, numbers, error)
      if (.not. allocated(numbers)) allocate (numbers(0))
      call file%close(error)
   end function numbers_of

   !> Reads the file, possibly of a run that has not ended.
   subroutine read_record(self, path, error)
      type(record_t), intent(out) :: self
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error
      type(stored_file_t) :: stored

      call check_source(path, error)
      if (allocated(error)) return
      call open_file(stored%file, path, error)
      if (.not. allocated(error)) call read_attributes(self, stored%file, error)
      if (.not. allocated(error)) call read_origin(self, stored%file, error)
      call stored%list(error)
      if (.not. allocated(error)) call read_columns(self, stored, error)
      call stored%file%close(error)
      call annotate(error, "'"//path//"' is not a result file of this program")
   end subroutine read_record

   !> Stores in a plan the units of its parameters that are in the file; others remain empty.
   subroutine read_units(path, plan)
      character(*), intent(in) :: path
      type(sweep_plan_t), intent(inout) :: plan
      type(h5_file_t) :: file
      type(h5_dataset_t) :: dataset
      type(error_t), allocatable :: error
      character(:), allocatable :: units
      integer :: i
      logical :: is_open

      call open_file(file, path, error)
      is_open = .not. allocated(error)
      do i = 1, size(plan%parameters)
         plan%parameters(i)%units = ""
         if (.not. is_open) cycle
         call file%open_dataset(identifier(plan%parameters(i)%path), dataset, error)
         if (allocated(error)) cycle
         call dataset%get_attribute("units", units, error)
         if (.not. allocated(error)) plan%parameters(i)%units = units
         call dataset%close()
      end do
      if (is_open) call file%close(error)
   end subroutine read_units

   subroutine read_attributes(self, file, error)
      type(record_t), intent(inout) :: self
      type(h5_file_t), intent(in) :: file
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: without_coordinates, without_doubt, without_kind
      character(:), allocatable :: coordinates, kind, doubt
      integer :: version

      call file%get_attribute("kind", kind, without_kind)
      if (.not. allocated(without_kind)) then
         call fail(error, "it is a record of "//kind//"; nhbm-post info reads it")
         return
      end if
      call file%get_attribute("schema_version", version, error)
      if (allocated(error)) return
      if (version /= schema_version) then
         call fail(error, "its schema version is "//to_text(version)//", this program reads "//to_text(schema_version))
         return
      end if
      call file%get_attribute("n_ranks", self%n_ranks, error)
      if (.not. allocated(error)) call file%get_attribute("title", self%title, error)
      if (.not. allocated(error)) call file%get_attribute("program_version", self%program_version, error)
      if (.not. allocated(error)) call file%get_attribute("git_commit", self%git_commit, error)
      if (.not. allocated(error)) call file%get_attribute("created_utc", self%created_utc, error)
      if (allocated(error)) return
      call file%get_attribute("coordinates", coordinates, without_coordinates)
      if (.not. allocated(without_coordinates)) self%is_census = index(coordinates, "census_motion") > 0
      call file%get_attribute("law_findings", doubt, without_doubt)
      if (.not. allocated(without_doubt)) self%law_findings = doubt
   end subroutine read_attributes

   !> Stores what is wrong with user laws in a file of results, for runs that continue it; if an earlier run has found anything and
   !> this one has not, the text becomes that one.
   subroutine store_law_findings(path, text, error)
      character(*), intent(in) :: path                                !! which must be closed
      character(:), allocatable, intent(inout) :: text                !! not allocated: nothing is known to be wrong
      type(error_t), allocatable, intent(out) :: error
      type(h5_file_t) :: file
      type(error_t), allocatable :: without_doubt
      character(:), allocatable :: before

      call open_file(file, path, error, for_writing=allocated(text))
      if (allocated(error)) return
      call file%get_attribute("law_findings", before, without_doubt)
      if (allocated(without_doubt)) then
         if (allocated(text)) call file%set_attribute("law_findings", text, error)
      else if (.not. allocated(text)) then
         text = before
      end if
      if (allocated(error)) return
      call file%close(error)
   end subroutine store_law_findings

   !> Reads the input and the labels.
   subroutine read_origin(self, file, error)
      type(record_t), intent(inout) :: self
      type(h5_file_t), intent(in) :: file
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: without_folder
      type(h5_dataset_t) :: dataset
      character(:), allocatable :: overrides

      call read_one(file, "input_text", self%input_text, error)
      call read_one(file, "input_overrides", overrides, error)
      call read_one(file, "input_complete", self%input_complete, error)
      call read_one(file, "input_libraries", self%input_libraries, error)
      call file%get("dof", self%dofs, error)
      call file%get("law", self%laws, error)
      if (allocated(error)) return
      call read_overrides(overrides, self%overrides)
      call file%open_dataset("input_text", dataset, error)
      if (.not. allocated(error)) call dataset%get_attribute("file_name", self%input_name, error)
      if (allocated(error)) return
      call dataset%get_attribute("folder", self%input_folder, without_folder)
      if (allocated(without_folder)) self%input_folder = ""           ! of an older version
   end subroutine read_origin

   !> Reads the columns of all points.
   subroutine read_columns(self, stored, error)
      type(record_t), intent(inout) :: self
      type(stored_file_t), intent(in) :: stored
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: errors(:), frequency(:)

      call stored%fetch("status", self%status, error)
      if (allocated(error)) return
      self%n_points = size(self%status)
      if (self%n_points == 0 .or. .not. all(is_status(self%status))) then
         call fail(error, "dataset 'status' has no points, or numbers that are no status")
         return
      end if
      call stored%fetch("fallback", self%fallback, error)
      call check_meanings(self, stored%file, "status", outcome_names, error)
      call check_meanings(self, stored%file, "fallback", fallback_names, error)
      call stored%fetch("is_near_commensurate", self%is_near_commensurate, error)
      call stored%fetch("is_stable", self%is_stable, error)
      self%stability_reason = spread(0, 1, self%n_points)             ! normal modes, and runs without stability, have none
      if (stored%file%has("stability_reason")) call stored%fetch("stability_reason", self%stability_reason, error)
      call stored%fetch("branch", self%branch, error)
      call stored%fetch("residual", self%residual, error)
      call stored%fetch("solve_seconds", self%solve_seconds, error)
      call stored%fetch("truncation_estimate", self%truncation, error)
      call stored%fetch("aliasing_estimate", self%aliasing, error)
      if (stored%file%has("level_estimate")) call stored%fetch("level_estimate", self%by_levels, error)
      call stored%fetch("penetration", self%penetration, error)
      call stored%fetch("frequency", frequency, error)
      self%has_own_tuples = stored%file%has("tuples")
      associate (n_tones => stored%plan%length_of("tone"))
         if (.not. self%has_own_tuples) call stored%get_tuples(1, self%tuples, error)
         if (self%has_own_tuples) allocate (self%tuples(n_tones, stored%plan%length_of("harmonic")), source=0)
         if (.not. allocated(error)) self%frequency = reshape(frequency, [n_tones, self%n_points])
         if (.not. allocated(error) .and. stored%file%has("frequency_estimate")) then
            call stored%fetch("frequency_estimate", errors, error)
            if (.not. allocated(error)) &
               self%of_frequency = largest_shares(reshape(errors, [n_tones, self%n_points]), self%frequency)
         end if
      end associate
   end subroutine read_columns

   !> The largest of some errors relative to their values, at each point; 0 where they are not known.
   pure function largest_shares(errors, values) result(largest)
      real(wp), intent(in) :: errors(:, :), values(:, :)              !! (any, n_points)
      real(wp) :: largest(size(errors, 2))
      integer :: i, k

      largest = 0.0_wp
      do i = 1, size(errors, 2)
         do k = 1, size(errors, 1)
            if (.not. (ieee_is_finite(errors(k, i)) .and. ieee_is_finite(values(k, i)))) cycle
            if (abs(values(k, i)) > 0.0_wp) largest(i) = max(largest(i), errors(k, i)/values(k, i))
         end do
      end do
   end function largest_shares

   !> Rejects a column whose numbers have other names in the file than in this program, which may have further ones; no effect
   !> after an error.
   subroutine check_meanings(self, file, column, names, error)
      type(record_t), intent(in) :: self
      type(h5_file_t), intent(in) :: file
      character(*), intent(in) :: column, names(:)
      type(error_t), allocatable, intent(inout) :: error
      type(h5_dataset_t) :: dataset
      character(:), allocatable :: meanings

      if (allocated(error)) return
      call file%open_dataset(column, dataset, error)
      if (.not. allocated(error)) call dataset%get_attribute("flag_meanings", meanings, error)
      call dataset%close()
      if (allocated(error)) return
      if (index(join(names, " ")//" ", trim(meanings)//" ") == 1) return
      call fail(error, "the numbers of '"//column//"' mean other things than in this version of the program; it was made by "// &
                "version "//self%program_version//", commit "//self%git_commit)
   end subroutine check_meanings

   !> Reads a single text; no effect after an error.
   subroutine read_one(file, name, text, error)
      type(h5_file_t), intent(in) :: file
      character(*), intent(in) :: name
      character(:), allocatable, intent(out) :: text
      type(error_t), allocatable, intent(inout) :: error
      type(texts_t) :: texts

      call file%get(name, texts%values, error, [1])
      if (.not. allocated(error)) text = texts%values(1)
   end subroutine read_one

   !> Lines of a text that are not empty.
   pure subroutine read_overrides(text, overrides)
      character(*), intent(in) :: text
      type(string_t), allocatable, intent(out) :: overrides(:)
      type(string_t), allocatable :: lines(:)
      integer :: i, n

      call split(text, new_line("a"), lines)
      allocate (overrides(size(lines)))
      n = 0
      do i = 1, size(lines)
         if (len_trim(lines(i)%value) == 0) cycle
         n = n + 1
         overrides(n)%value = lines(i)%value
      end do
      overrides = overrides(:n)
   end subroutine read_overrides

   !> Whether the tuples of the file are those of its input. A complete file with tuples of each point may have room for fewer.
   pure logical function record_has_tuples(self, tuples) result(has_tuples)
      class(record_t), intent(in) :: self
      integer, intent(in) :: tuples(:, :)                             !! that the input gives

      has_tuples = size(tuples, 1) == size(self%tuples, 1) .and. size(tuples, 2) >= size(self%tuples, 2)
      if (self%has_own_tuples .or. .not. has_tuples) return
      has_tuples = size(tuples, 2) == size(self%tuples, 2)
      if (has_tuples) has_tuples = all(tuples == self%tuples)
   end function record_has_tuples

   !> Finds the damaged rows.
   subroutine record_check_rows(self, path, error)
      class(record_t), intent(inout) :: self
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error

      call find_damaged_rows(path, self%status, self%is_damaged, error)
   end subroutine record_check_rows

   !> The points, from 1, that a resumed run must solve: those that are pending or known to be damaged and, if
   !> `retries`, those whose solver has failed.
   pure function open_points(self, retries) result(points)
      type(record_t), intent(in) :: self
      logical, intent(in) :: retries
      integer, allocatable :: points(:)
      logical :: is_open(self%n_points)
      integer :: i

      is_open = self%status == outcome%pending .or. (retries .and. .not. is_solved(self%status) .and. self%status /= outcome%unused)
      if (allocated(self%is_damaged)) is_open = is_open .or. self%is_damaged
      points = pack([(i, i=1, self%n_points)], is_open)
   end function open_points

   !> Finds the points whose numbers differ from those that were written. Points without a result, or with a recorded
   !> crash, have no checksum.
   subroutine find_damaged_rows(path, status, is_damaged, error)
      character(*), intent(in) :: path
      integer, intent(in) :: status(:)                                !! of the points
      logical, allocatable, intent(out) :: is_damaged(:)              !! (points)
      type(error_t), allocatable, intent(out) :: error
      type(h5_file_t) :: file
      type(h5_dataset_t) :: dataset
      character(:), allocatable :: names
      integer :: expected(size(status)), found(size(status))
      logical :: has_checksum(size(status))

      allocate (is_damaged(size(status)), source=.false.)
      has_checksum = status /= outcome%pending .and. status /= outcome%crashed
      call open_file(file, path, error)
      if (.not. allocated(error)) call file%open_dataset("checksum", dataset, error)
      if (.not. allocated(error)) call dataset%read(expected, error)
      if (.not. allocated(error)) call dataset%get_attribute("of", names, error)
      if (.not. allocated(error)) call add_up(file, path, names, has_checksum, found, error)
      call file%close(error)
      call annotate(error, "checksums of '"//path//"'")
      if (allocated(error)) return
      is_damaged = found /= expected .and. has_checksum
   end subroutine find_damaged_rows

   !> Fails if rows of these points are damaged.
   subroutine reject_damaged_rows(path, status, points, error)
      character(*), intent(in) :: path
      integer, intent(in) :: status(:)                                !! of all points
      integer, intent(in) :: points(:)                                !! from 0; empty: all
      type(error_t), allocatable, intent(out) :: error
      logical, allocatable :: is_damaged(:)
      integer :: i

      call find_damaged_rows(path, status, is_damaged, error)
      if (allocated(error)) return
      if (size(points) > 0) is_damaged = is_damaged .and. [(any(points == i - 1), i=1, size(status))]
      call fail_where_damaged(path, is_damaged, error)
   end subroutine reject_damaged_rows

   !> Fails with the names of damaged points, if there are any.
   pure subroutine fail_where_damaged(path, is_damaged, error)
      character(*), intent(in) :: path
      logical, intent(in) :: is_damaged(:)                            !! (points)
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: max_named_points = 20                     ! points named in the message
      integer, allocatable :: points(:)
      type(string_t), allocatable :: names(:)
      character(:), allocatable :: more
      integer :: i

      points = pack([(i - 1, i=1, size(is_damaged))], is_damaged)
      if (size(points) == 0) return
      allocate (names(min(size(points), max_named_points)))
      do i = 1, size(names)
         names(i)%value = to_text(points(i))
      end do
      more = ""
      if (size(points) > max_named_points) more = " and "//to_text(size(points) - max_named_points)//" more"
      call fail(error, "result file '"//path//"' is damaged: the results of "//number_of(size(points), "point")// &
                " are not what was written ("//join(names, ", ")//more//"); nhbm resume "//path//" solves them again")
   end subroutine fail_where_damaged

   !> Checksums of rows over the datasets of these names, separated by blanks. Of the others, whose part of the file may be empty,
   !> only those between them are read.
   subroutine add_up(file, path, names, is_wanted, checksums, error)
      type(h5_file_t), intent(in) :: file
      character(*), intent(in) :: path, names
      logical, intent(in) :: is_wanted(:)                             !! (rows)
      integer, intent(out) :: checksums(:)
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: value_sizes(3) = [4, 8, 1]
      type(h5_dataset_t) :: dataset
      type(string_t), allocatable :: words(:)
      integer(int64) :: offset, row_bytes
      integer :: i, k
      logical :: ok

      checksums = 0
      call split(names, " ", words)
      do i = 1, size(words)
         call file%open_dataset(words(i)%value, dataset, error)
         if (allocated(error)) return
         associate (extents => dataset%get_extents())
            ok = size(extents) > 0
            if (ok) ok = extents(size(extents)) == size(checksums)
            row_bytes = 0
            if (ok) row_bytes = product(int(extents(:size(extents) - 1), int64))
         end associate
         if (ok .and. row_bytes == 0) cycle
         offset = -1
         do k = 1, size(value_sizes)
            if (offset < 0) offset = dataset%get_offset(value_sizes(k))
            if (offset >= 0) exit
         end do
         if (.not. ok) then
            call fail(error, "dataset '"//words(i)%value//"' has not one row for each of the "//number_of(size(checksums), "point"))
         else if (offset < 0) then
            call fail(error, "dataset '"//words(i)%value//"' is stored in chunks, as another program does, perhaps compressed; "// &
                      "h5repack -l CONTI -f NONE OLD NEW makes a file that can be checked and continued")
         else
            call add_wanted(row_bytes*value_sizes(k))
         end if
         if (allocated(error)) return
      end do

   contains

      !> Continues the checksums of wanted rows of so many bytes, over gaps that are shorter than a block.
      subroutine add_wanted(n_bytes)
         integer(int64), intent(in) :: n_bytes
         integer(int64), parameter :: copied_bytes = 2_int64**20
         integer :: first, last, next

         first = findloc(is_wanted, .true., dim=1)
         do while (first > 0 .and. ok)
            last = first
            do
               next = last + findloc(is_wanted(last + 1:), .true., dim=1)
               if (next == last .or. (next - last - 1)*n_bytes > copied_bytes) exit
               last = next
            end do
            call checksum_rows(path, offset + (first - 1)*n_bytes, n_bytes, checksums(first:last), ok)
            first = merge(0, next, next == last)
         end do
      end subroutine add_wanted
   end subroutine add_up

   !> Counts the points without a result in a file on the disk.
   subroutine count_pending(path, n_pending, error)
      character(*), intent(in) :: path
      integer, intent(out) :: n_pending
      type(error_t), allocatable, intent(out) :: error
      type(h5_file_t) :: file
      integer, allocatable :: status(:)

      n_pending = 0
      call open_file(file, path, error, message="was changed while the run wrote it, HDF5 crashes on it; results are lost")
      call file%get("status", status, error)
      if (.not. allocated(error)) n_pending = count(status == outcome%pending)
      call file%close(error)
   end subroutine count_pending
end module hb_results_record
