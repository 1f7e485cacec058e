!> Reads scenes from namelist documents: which groups there are, and in which order they are read, each by its own procedure.
module hb_scene_reader
   use hb_error, only: annotate, error_t
   use hb_kinds, only: wp
   use hb_march_config, only: read_march
   use hb_memory_estimate, only: check_memory
   use hb_namelist, only: document_t, group_t
   use hb_scene, only: scene_t
   use hb_scene_laws, only: read_laws, read_laws_again
   use hb_scene_loads, only: read_loads
   use hb_scene_settings, only: read_certificate, read_output, read_sampling, read_solver
   use hb_scene_sizes, only: sizes_of
   use hb_scene_symmetry, only: check_symmetry
   use hb_scene_tones, only: read_tones
   use hb_scene_unknown_tones, only: check_fundamentals, read_normal_mode, read_phase
   use hb_structure_catalogue, only: read_structure
   use hb_tones, only: tones_t
   use hb_truncation, only: read_harmonics, symmetry
   implicit none
   private
   public :: group_names, groups_read_again, read_again, read_scene

   !> Every group that an input file may have.
   character(11), parameter :: group_names(13) = [character(11) :: &
      "structure", "tones", "phase", "harmonics", "sampling", "load", "law", "start", "normal_mode", "solver", &
      "certificate", "output", "march"]

   !> Groups of numbers that many points of a study differ in.
   character(5), parameter :: groups_read_again(4) = [character(5) :: "tones", "load", "law", "start"]

contains

   !> Reads a scene. All problems of the input are collected in one message, a line each. Fails as well where the scene would
   !> need more memory than its key `memory_limit` or, where that is zero, `available` says.
   subroutine read_scene(self, document, error, available)
      type(scene_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: available                     !! bytes for this process

      if (present(available)) self%memory_limit = available
      call read_parts(self, document, error)
      if (.not. allocated(error)) call document%finish(error)
   end subroutine read_scene

   !> Reads group after group; `error` is what stops the reading, problems of single keys wait in the document.
   subroutine read_parts(self, document, error)
      type(scene_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(group_t), pointer :: group

      call read_solver(self, document%optional_group("solver"))
      call document%required_group("structure", group, error)
      if (allocated(error)) return
      call read_structure(group, self%structure, error, self%memory_limit)
      if (allocated(error)) return
      call read_tones(self%tones, document, error)
      if (allocated(error)) return
      call read_harmonics(self%harmonics, document, self%tones%n_tones, error, self%symmetry)
      if (allocated(error)) return
      call read_laws(self, document, error)
      if (allocated(error)) return
      call read_certificate(self%certificate, document%optional_group("certificate"))
      call read_output(self, document%optional_group("output"))
      call read_sampling(self, document%optional_group("sampling"))
      call check_memory(sizes_of(self), self%memory_limit, error)
      if (allocated(error)) then
         call annotate(error, document%file_name)
         return
      end if
      allocate (self%loads(self%structure%n_dofs, self%harmonics%n_harmonics), source=(0.0_wp, 0.0_wp))
      allocate (self%load_slopes, self%start, source=self%loads)
      call read_loads(self, document)
      call check_symmetry(self, document%optional_group("harmonics"))
      call check_memory(sizes_of(self), self%memory_limit, error)     ! again: loads tell whether motions are odd
      if (allocated(error)) then
         call annotate(error, document%file_name)
         return
      end if
      if (any(self%tones%is_unknown)) then
         if (self%certificate%improvement_steps > 0) then
            group => document%optional_group("certificate")
            call group%problem("improvement_steps", "only tones that are given allow it; leave it out")
         end if
         call check_fundamentals(self, document%optional_group("harmonics"))
         call read_phase(self, document%optional_group("phase"))
      end if
      if (document%count("normal_mode") > 0) call read_normal_mode(self, document%optional_group("normal_mode"))
      call read_march(self%march, document%optional_group("march"))
   end subroutine read_parts

   !> Reads those of `&tones`, `&law`, `&load` and `&start` anew that a document has, into a scene whose other groups are as before.
   !> `is_read` is false, and the scene of no use, where something is wrong with them, or where they differ in more than numbers.
   subroutine read_again(self, document, is_read)
      type(scene_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document             !! nothing else; of a name all groups or none
      logical, intent(out) :: is_read
      type(tones_t) :: tones
      type(error_t), allocatable :: error

      is_read = .false.
      if (any(self%tones%is_unknown) .or. self%symmetry == symmetry%odd) return
      if (document%count("tones") > 0) then
         call read_tones(tones, document, error)
         if (allocated(error)) return
         if (tones%n_tones /= self%tones%n_tones .or. any(tones%is_unknown)) return
         self%tones = tones
      end if
      call read_laws_again(self, document, is_read)
      if (.not. is_read) return
      call read_loads(self, document)
      call document%finish(error)
      is_read = .not. allocated(error)
   end subroutine read_again
end module hb_scene_reader
