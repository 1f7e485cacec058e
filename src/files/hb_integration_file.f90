!> The HDF5 file of a time integration: record, coefficients, and the state from which it can be continued.
!>
!> One process writes it whole under a temporary name and then renames it. docs/user/schema.md lists its contents.
module hb_integration_file
   use hb_error, only: annotate, error_t
   use hb_file_location, only: check_place, put_in_place
   use hb_hdf5, only: create_file, h5_dataset_t, h5_file_t, open_file
   use hb_integration, only: integration_t
   use hb_integration_laws, only: integration_laws_t
   use hb_integration_system, only: integration_state_t
   use hb_kinds, only: wp
   use hb_structure, only: structure_t
   use hb_system, only: process_id, remove_file, utc_now
   use hb_text, only: join, to_text
   use hb_time_stepping, only: integration_assessment_t, integration_record_t
   use hb_version, only: git_commit, program_version
   implicit none
   private
   public :: integration_origin_t, read_integration_state, write_integration_file

   integer, parameter :: schema_version = 1
   character(*), parameter :: amplitude_convention = "x(t) = sum over harmonics h of "// &
      "[ cos_h cos(j_h . omega t) + sin_h sin(j_h . omega t) ], j_h = tuple[h, :]"

   !> The origin of a record.
   type :: integration_origin_t
      character(:), allocatable :: title, method, input_text, input_complete
      real(wp), allocatable :: omega(:)                               !! base frequencies [rad/s]
      integer, allocatable :: tuples(:, :)                            !! (n_tones, n_harmonics)
      integer, allocatable :: retained_dofs(:)
   end type integration_origin_t

   type(h5_dataset_t), parameter :: no_scales(0) = [h5_dataset_t ::]

   !> A file being written, with the scales of its dimensions.
   type :: writer_t
      type(h5_file_t) :: file
      type(h5_dataset_t) :: time, dof, coordinate, harmonic, tone, component, peak, state_dof, slider
   end type writer_t

contains

   !> Writes the file; refuses an existing one unless `overwrite`.
   subroutine write_integration_file(path, overwrite, origin, structure, laws, content, error)
      character(*), intent(in) :: path
      logical, intent(in) :: overwrite
      type(integration_origin_t), intent(in) :: origin
      type(structure_t), intent(in) :: structure
      type(integration_laws_t), intent(in) :: laws
      type(integration_t), intent(in) :: content
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close
      type(writer_t) :: writer
      character(:), allocatable :: temporary

      call check_place(path, overwrite, error)
      temporary = path//"."//to_text(process_id())//".part"
      if (.not. allocated(error)) then
         call create_file(writer%file, temporary, .true., error)
         if (.not. allocated(error)) call write_attributes(writer%file, origin, error)
         call write_scales(writer, origin, structure, laws, content%record, content%assessment, error)
         call write_record(writer, origin, structure, content%record, error)
         call write_assessment(writer, origin, structure, content%assessment, error)
         call write_state(writer, structure, content%state, error)
         if (allocated(content%motion)) call write_motions(writer, origin, structure, content, error)
         call writer%file%put("input_text", origin%input_text, "the input as given", error)
         call writer%file%put("input_complete", origin%input_complete, "the input after defaults", error)
         call writer%file%close(error_in_close)
         if (.not. allocated(error)) call move_alloc(error_in_close, error)
         if (.not. allocated(error)) call put_in_place(temporary, path, overwrite, error)
         if (allocated(error)) call remove_file(temporary)
      end if
      call annotate(error, "time integration record '"//path//"'")
   end subroutine write_integration_file

   subroutine write_attributes(file, origin, error)
      type(h5_file_t), intent(in) :: file
      type(integration_origin_t), intent(in) :: origin
      type(error_t), allocatable, intent(out) :: error

      call file%set_attribute("schema_version", schema_version, error)
      call set("kind", "integration")
      call set("method", origin%method)
      call set("program_version", program_version)
      call set("git_commit", git_commit)
      call set("created_utc", utc_now())
      call set("title", origin%title)
      call set("amplitude_convention", amplitude_convention)
   contains
      subroutine set(name, value)
         character(*), intent(in) :: name, value

         if (.not. allocated(error)) call file%set_attribute(name, value, error)
      end subroutine set
   end subroutine write_attributes

   subroutine write_scales(self, origin, structure, laws, record, assessment, error)
      type(writer_t), intent(inout) :: self
      type(integration_origin_t), intent(in) :: origin
      type(structure_t), intent(in) :: structure
      type(integration_laws_t), intent(in) :: laws
      type(integration_record_t), intent(in) :: record
      type(integration_assessment_t), intent(in) :: assessment
      type(error_t), allocatable, intent(inout) :: error

      call self%file%put("time", record%time, no_scales, "s", "time", error, self%time)
      call make_scale(self%time, "time", error)
      call texts("dof", structure%labels(origin%retained_dofs), self%dof, "label of the degree of freedom")
      if (laws%n_coordinates > 0) call texts("law_coordinate", laws%coordinate_labels(), self%coordinate, &
                                             "coordinate of a law")
      call numbers("harmonic", size(origin%tuples, 2), 0, self%harmonic, "number of the harmonic")
      call numbers("tone", size(origin%omega), 1, self%tone, "number of the tone")
      call texts("component", ["cos", "sin"], self%component, "cosine or sine")
      if (size(assessment%frequencies, 1) > 0) then
         call numbers("peak", size(assessment%frequencies, 1), 1, self%peak, "number of the line, the largest first")
      end if
      call texts("state_dof", structure%labels, self%state_dof, "label of the degree of freedom")
      if (laws%n_states > 0) call numbers("slider", laws%n_states, 1, self%slider, "number of the state of a law with memory")

   contains

      subroutine texts(name, values, scale, long_name)
         character(*), intent(in) :: name, values(:), long_name
         type(h5_dataset_t), intent(inout) :: scale

         if (allocated(error)) return
         call self%file%add_texts(name, values, scale, error)
         call scale%describe("1", long_name, error)
         call make_scale(scale, name, error)
      end subroutine texts

      subroutine numbers(name, n, first, scale, long_name)
         character(*), intent(in) :: name, long_name
         integer, intent(in) :: n, first
         type(h5_dataset_t), intent(inout) :: scale
         integer :: i

         call self%file%put(name, [(first + i, i=0, n - 1)], no_scales, "1", long_name, error, scale)
         call make_scale(scale, name, error)
      end subroutine numbers
   end subroutine write_scales

   subroutine make_scale(scale, name, error)
      type(h5_dataset_t), intent(in) :: scale
      character(*), intent(in) :: name
      type(error_t), allocatable, intent(inout) :: error

      if (.not. allocated(error)) call scale%make_scale(name, error)
   end subroutine make_scale

   subroutine write_record(self, origin, structure, record, error)
      type(writer_t), intent(in) :: self
      type(integration_origin_t), intent(in) :: origin
      type(structure_t), intent(in) :: structure
      type(integration_record_t), intent(in) :: record
      type(error_t), allocatable, intent(inout) :: error
      character(:), allocatable :: units

      units = join(structure%units(origin%retained_dofs), " ")
      call put_by_dof(self, "displacement", record%displacement, [self%time, self%dof], units, "displacement", error)
      call put_by_dof(self, "velocity", record%velocity, [self%time, self%dof], rate_units(structure%units(origin%retained_dofs)), &
                      "velocity", error)
      if (size(record%force) > 0) call self%file%put("force", record%force, [self%time, self%coordinate], "N", &
         "force of the laws on their coordinates, on the left-hand side", error)
      call self%file%put("cpu_seconds", record%cpu_seconds, no_scales, "s", "processor time of the integration", error)
   end subroutine write_record

   subroutine write_assessment(self, origin, structure, assessment, error)
      type(writer_t), intent(in) :: self
      type(integration_origin_t), intent(in) :: origin
      type(structure_t), intent(in) :: structure
      type(integration_assessment_t), intent(in) :: assessment
      type(error_t), allocatable, intent(inout) :: error
      character(:), allocatable :: units

      units = join(structure%units(origin%retained_dofs), " ")
      call self%file%put("tuple", origin%tuples, [self%tone, self%harmonic], "1", "integer tuple j of each harmonic", error)
      call self%file%put("frequency", origin%omega, [self%tone], "rad/s", "base frequencies", error)
      call put_by_dof(self, "coefficients", as_pairs(assessment%coefficients), [self%component, self%harmonic, self%dof], units, &
                      "coefficients of the record by averages with a smooth window", error)
      call put_by_dof(self, "spread", assessment%spread, [self%harmonic, self%dof], units, &
                      "difference of the coefficients of both halves of the record", error)
      if (size(assessment%frequencies, 1) == 0) return
      call self%file%put("peak_frequency", assessment%frequencies, [self%peak, self%dof], "rad/s", &
         "frequencies of the largest lines", error)
      call put_by_dof(self, "peak_coefficients", as_pairs(assessment%amplitudes), [self%component, self%peak, self%dof], units, &
                      "coefficients of the largest lines", error)
   end subroutine write_assessment

   !> Writes the motions in which several starts end.
   subroutine write_motions(self, origin, structure, content, error)
      type(writer_t), intent(in) :: self
      type(integration_origin_t), intent(in) :: origin
      type(structure_t), intent(in) :: structure
      type(integration_t), intent(in) :: content
      type(error_t), allocatable, intent(inout) :: error
      type(h5_dataset_t) :: start, motion
      complex(wp) :: c(size(origin%tuples, 2), size(origin%retained_dofs), size(content%motions))
      real(wp) :: pairs(2, size(c, 1), size(c, 2), size(c, 3)), spread(size(c, 1), size(c, 2), size(c, 3))
      character(:), allocatable :: units
      integer :: i

      do i = 1, size(content%motions)
         c(:, :, i) = content%motions(i)%coefficients
         spread(:, :, i) = content%motions(i)%spread
      end do
      pairs(1, :, :, :) = real(c, wp)
      pairs(2, :, :, :) = -aimag(c)
      units = join(structure%units(origin%retained_dofs), " ")
      call self%file%put("start", [(i, i=1, size(content%motion))], no_scales, "1", "number of the start", error, start)
      call make_scale(start, "start", error)
      call self%file%put("motion", [(i, i=1, size(content%motions))], no_scales, "1", "number of the motion", error, motion)
      call make_scale(motion, "motion", error)
      call self%file%put("start_motion", content%motion, [start], "1", "motion in which each start ends, 0: none", error)
      call put_by_dof(self, "motion_coefficients", pairs, [self%component, self%harmonic, self%dof, motion], units, &
                      "coefficients of each motion", error)
      call put_by_dof(self, "motion_spread", spread, [self%harmonic, self%dof, motion], units, &
                      "difference of the coefficients of both halves of its record", error)
   end subroutine write_motions

   subroutine write_state(self, structure, state, error)
      type(writer_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      type(integration_state_t), intent(in) :: state
      type(error_t), allocatable, intent(inout) :: error

      call self%file%put("state_time", state%time, no_scales, "s", "time of the last state", error)
      call put_by_dof(self, "state_displacement", state%q, [self%state_dof], join(structure%units, " "), &
                      "displacement of the last state", error)
      call put_by_dof(self, "state_velocity", state%v, [self%state_dof], rate_units(structure%units), &
                      "velocity of the last state", error)
      if (size(state%s) > 0) call self%file%put("state_slider", state%s, [self%slider], "m", &
         "states of the laws with memory in the last state", error)
   end subroutine write_state

   !> Writes values of the degrees of freedom, whose units are a list separated by blanks.
   subroutine put_by_dof(self, name, values, scales, units, long_name, error)
      type(writer_t), intent(in) :: self
      character(*), intent(in) :: name
      real(wp), intent(in), contiguous :: values(..)
      type(h5_dataset_t), intent(in) :: scales(:)                     !! fastest first
      character(*), intent(in) :: units, long_name
      type(error_t), allocatable, intent(inout) :: error
      type(h5_dataset_t) :: dataset

      call self%file%put(name, values, scales, common_unit(units), long_name, error, dataset)
      if (.not. allocated(error)) call dataset%set_attribute("dof_units", trim(units), error)
   end subroutine put_by_dof

   !> The first unit if all are equal.
   pure function common_unit(units)
      character(*), intent(in) :: units                               !! separated by blanks
      character(:), allocatable :: common_unit, remaining

      common_unit = units(:index(units//" ", " ") - 1)
      remaining = adjustl(units)
      do while (len_trim(remaining) > 0)
         if (remaining(:index(remaining//" ", " ") - 1) /= common_unit) then
            common_unit = "see dof_units"
            return
         end if
         remaining = trim(adjustl(remaining(index(remaining//" ", " "):)))
      end do
   end function common_unit

   !> Units of the rates of change, separated by blanks.
   pure function rate_units(units)
      character(*), intent(in) :: units(:)
      character(:), allocatable :: rate_units
      integer :: i

      rate_units = ""
      do i = 1, size(units)
         rate_units = rate_units//trim(units(i))//"/s "
      end do
      rate_units = trim(rate_units)
   end function rate_units

   !> Amplitudes c - i s as (cosine and sine, ...).
   pure function as_pairs(amplitudes) result(pairs)
      complex(wp), intent(in) :: amplitudes(:, :)
      real(wp) :: pairs(2, size(amplitudes, 1), size(amplitudes, 2))

      pairs(1, :, :) = real(amplitudes, wp)
      pairs(2, :, :) = -aimag(amplitudes)
   end function as_pairs

   !> Reads the last state of a record; fails unless it has the same structure and laws.
   subroutine read_integration_state(path, state, error)
      character(*), intent(in) :: path
      type(integration_state_t), intent(inout) :: state               !! with the correct sizes
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close
      type(h5_file_t) :: file
      real(wp), allocatable :: time(:)
      integer :: n_dofs, n_states

      call open_file(file, path, error)
      if (allocated(error)) return
      n_dofs = size(state%q)
      n_states = size(state%s)
      call file%get("state_time", time, error, [1])
      call file%get("state_displacement", state%q, error, [n_dofs])
      call file%get("state_velocity", state%v, error, [n_dofs])
      if (n_states > 0) call file%get("state_slider", state%s, error, [n_states])
      call annotate(error, "no record, or a record of another model")
      call file%close(error_in_close)
      if (.not. allocated(error)) call move_alloc(error_in_close, error)
      if (.not. allocated(error)) state%time = time(1)
      call annotate(error, "&integration continue")
   end subroutine read_integration_state
end module hb_integration_file
