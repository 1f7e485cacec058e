!> A scene: all that one point of a study needs, read from a namelist document.
!>
!> The component initialisers of the types here and below are the defaults of the input; docs/input.md lists the keys.
module hb_scene
   use hb_error, only: annotate, error_t
   use hb_fftw, only: planning, planning_names
   use hb_harmonics, only: harmonics_t, new_box, new_diamond, new_harmonics
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_box_t
   use hb_law_catalogue, only: read_law
   use hb_loads, only: add_harmonic
   use hb_march_config, only: march_config_t, read_march
   use hb_namelist, only: document_t, group_t
   use hb_solver_types, only: method_names, solver_config_t, start_names
   use hb_structure, only: structure_t
   use hb_structure_catalogue, only: read_structure
   use hb_text, only: string_t, to_text
   use hb_tones, only: new_tones, tones_t
   use hb_torus, only: default_samples, new_torus, torus_t
   implicit none
   private
   public :: group_names, output_config_t, read_harmonics, read_scene, read_tones, scene_t

   !> Every group that an input file may have.
   character(11), parameter :: group_names(11) = [character(11) :: &
      "structure", "tones", "harmonics", "sampling", "load", "law", "start", "solver", "certificate", "output", "march"]

   character(7), parameter :: first_guess_names(2) = [character(7) :: "linear", "zero"]

   !> What is kept of a result.
   type :: output_config_t
      character(:), allocatable :: title
      integer, allocatable :: dofs(:)                                 !! stored degrees of freedom
      integer, allocatable :: samples(:)                              !! grid of the stored surfaces, size 0: none
   end type output_config_t

   !> What makes a solved point count as not good enough.
   type :: certificate_config_t
      logical :: is_on = .true.
      real(wp) :: truncation = 0.1_wp                                 !! largest estimated error, relative to the motion
      real(wp) :: aliasing = 0.1_wp                                   !! largest estimated error, relative to the motion
      real(wp) :: penetration = 0.1_wp                                !! largest, relative to the largest harmonic
      real(wp) :: commensurability = 1.0e-3_wp                        !! smallest |k.omega| relative to the largest tone
   end type certificate_config_t

   type :: scene_t
      type(structure_t) :: structure
      type(tones_t) :: tones
      type(harmonics_t) :: harmonics
      type(torus_t) :: torus
      type(law_box_t), allocatable :: laws(:)
      complex(wp), allocatable :: loads(:, :)                         !! cos - i sin [N], (n_dofs, n_harmonics)
      complex(wp), allocatable :: start(:, :)                         !! added to the first guess [m], as loads
      type(solver_config_t) :: solver
      logical :: start_from_linear = .true.                           !! first guess: the motion without laws, else zero
      integer :: planning = planning%estimate                         !! effort of FFTW
      character(:), allocatable :: wisdom                             !! file with FFTW's wisdom
      type(certificate_config_t) :: certificate
      type(output_config_t) :: output
      type(march_config_t) :: march
   end type scene_t

contains

   !> Reads a scene. All problems of the input are collected in one message, a line each.
   subroutine read_scene(self, document, error)
      type(scene_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error

      call read_parts(self, document, error)
      if (.not. allocated(error)) call document%finish(error)
   end subroutine read_scene

   !> Reads group after group; `error` is what stops the reading, problems of single keys wait in the document.
   subroutine read_parts(self, document, error)
      type(scene_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(group_t), pointer :: group
      integer :: i

      call document%required_group("structure", group, error)
      if (allocated(error)) return
      call read_structure(group, self%structure, error)
      if (allocated(error)) return
      call read_tones(self%tones, document, error)
      if (allocated(error)) return
      call read_harmonics(self%harmonics, document, self%tones%n_tones, error)
      if (allocated(error)) return

      allocate (self%laws(document%count("law")))
      do i = 1, size(self%laws)
         group => document%group("law", i)
         call read_law(self%laws(i), group, self%structure, i)
         call check_kind(self%laws(i), group, error)
         if (allocated(error)) return
         call check_rigid_laws(self%laws(:i), group)
      end do
      allocate (self%loads(self%structure%n_dofs, self%harmonics%n_harmonics), source=(0.0_wp, 0.0_wp))
      allocate (self%start(self%structure%n_dofs, self%harmonics%n_harmonics), source=(0.0_wp, 0.0_wp))
      do i = 1, document%count("load")
         call read_amplitude(self, document%group("load", i), self%loads)
      end do
      do i = 1, document%count("start")
         call read_amplitude(self, document%group("start", i), self%start)
      end do
      call read_solver(self, document%optional_group("solver"))
      call read_certificate(self%certificate, document%optional_group("certificate"))
      call read_output(self, document%optional_group("output"))
      call read_sampling(self, document%optional_group("sampling"))
      call read_march(self%march, document%optional_group("march"))
   end subroutine read_parts

   !> Fails when the kind of a law is not known, and with that alone: none of the other keys of its group can be judged.
   subroutine check_kind(box, group, error)
      type(law_box_t), intent(in) :: box
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error

      if (allocated(box%law)) return
      call group%finish(error)
      error%message = error%message(:index(error%message//new_line("a"), new_line("a")) - 1)
   end subroutine check_kind

   !> Refuses the last law where it and one before are rigid and share a degree of freedom: each would take the whole
   !> reaction.
   subroutine check_rigid_laws(laws, group)
      type(law_box_t), intent(in) :: laws(:)
      type(group_t), intent(inout) :: group                           !! of the last law
      integer :: i, k

      if (.not. is_placed_and_rigid(laws(size(laws)))) return
      associate (last => laws(size(laws))%law)
         do i = 1, size(laws) - 1
            if (.not. is_placed_and_rigid(laws(i))) cycle
            if (.not. any([(laws(i)%law%dofs == last%dofs(k), k=1, size(last%dofs))])) cycle
            call group%problem("type", "laws '"//laws(i)%law%label//"' and '"//last%label//"' are both rigid and share a "// &
                               "degree of freedom; use one two-sided wall, or an elastic stop for one of them")
         end do
      end associate
   end subroutine check_rigid_laws

   logical function is_placed_and_rigid(box)
      type(law_box_t), intent(in) :: box

      is_placed_and_rigid = box%law%is_multiplier .and. allocated(box%law%dofs)   ! without a place: a problem by now
   end function is_placed_and_rigid

   !> Reads `&tones`: `frequency` [rad/s] or `hertz`.
   subroutine read_tones(self, document, error)
      type(tones_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(group_t), pointer :: group
      real(wp), allocatable :: omega(:)

      call document%required_group("tones", group, error)
      if (allocated(error)) return
      if (group%given("hertz")) then
         if (group%given("frequency")) then
            call group%problem("hertz", "give either 'frequency' [rad/s] or 'hertz', not both")
            call group%get("frequency", omega, above=0.0_wp)
         end if
         call group%get("hertz", omega, above=0.0_wp)
         if (allocated(omega)) omega = two_pi*omega
      else
         call group%require("frequency", omega, above=0.0_wp)
      end if
      call group%finish(error)
      if (allocated(error)) return
      call new_tones(self, omega, error)
      call annotate(error, group%place())
   end subroutine read_tones

   !> Reads `&harmonics`: `set` = box, diamond or list, with `order`, `odd_only`, `tuples`.
   subroutine read_harmonics(self, document, n_tones, error)
      type(harmonics_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      integer, intent(in) :: n_tones
      type(error_t), allocatable, intent(out) :: error
      type(group_t), pointer :: group
      integer, allocatable :: order(:), tuples(:)
      character(:), allocatable :: set
      logical :: odd_only
      character(7), parameter :: sets(3) = [character(7) :: "box", "diamond", "list"]

      call document%required_group("harmonics", group, error)
      if (allocated(error)) return
      set = "box"
      odd_only = .false.
      call group%get("set", set, choices=sets)
      if (set == "list") then
         call group%require("tuples", tuples)
         if (allocated(tuples)) then
            if (modulo(size(tuples), n_tones) /= 0) call group%problem("tuples", to_text(size(tuples))// &
               " integers are not a whole number of tuples of "//to_text(n_tones)//" tones")
         end if
      else
         call group%require("order", order, minimum=0)
         call group%get("odd_only", odd_only)
         if (allocated(order)) then
            if (size(order) == 1 .and. set == "box") order = spread(order(1), 1, n_tones)
            if (size(order) /= merge(n_tones, 1, set == "box")) call group%problem("order", &
               "give one number, or for a box one for each of the "//to_text(n_tones)//" tones")
         end if
      end if
      call group%finish(error)
      if (allocated(error)) return
      select case (set)
      case ("box")
         call new_box(self, order, odd_only, error)
      case ("diamond")
         call new_diamond(self, n_tones, order(1), odd_only, error)
      case default
         call new_harmonics(self, reshape(tuples, [n_tones, size(tuples)/n_tones]), error)
      end select
      call annotate(error, group%place())
   end subroutine read_harmonics

   !> Reads `&load` and `&start`: `dof`, `tuple`, `cos`, `sin`, added to the amplitudes.
   subroutine read_amplitude(self, group, amplitudes)
      type(scene_t), intent(in) :: self
      type(group_t), intent(inout) :: group
      complex(wp), intent(inout) :: amplitudes(:, :)
      character(:), allocatable :: name
      integer, allocatable :: tuple(:)
      type(error_t), allocatable :: error
      real(wp) :: cosine, sine
      integer :: dof

      cosine = 0.0_wp
      sine = 0.0_wp
      call group%require("dof", name)
      call group%require("tuple", tuple, n=self%tones%n_tones)
      call group%get("cos", cosine)
      call group%get("sin", sine)
      if (.not. (group%given("cos") .or. group%given("sin"))) then
         call group%problem("cos", "give 'cos', 'sin' or both")
      end if
      if (.not. (allocated(name) .and. allocated(tuple))) return
      if (size(tuple) /= self%tones%n_tones) return
      call self%structure%find_dof(name, dof, error)
      if (allocated(error)) then
         call group%problem("dof", error%message)
         return
      end if
      call add_harmonic(amplitudes, self%harmonics, dof, tuple, cosine, sine, error)
      if (allocated(error)) call group%problem("tuple", error%message)
   end subroutine read_amplitude

   !> Reads `&sampling`: `samples` per tone, effort and wisdom file of FFTW.
   subroutine read_sampling(self, group)
      type(scene_t), intent(inout) :: self
      type(group_t), intent(inout) :: group
      integer, allocatable :: samples(:)
      character(:), allocatable :: effort
      type(error_t), allocatable :: error
      integer :: degree, i

      degree = 1
      do i = 1, size(self%laws)
         if (self%laws(i)%law%degree == 0 .or. degree == 0) then
            degree = 0
         else
            degree = max(degree, self%laws(i)%law%degree)
         end if
      end do
      samples = default_samples(self%harmonics, degree)
      call group%get("samples", samples, minimum=1)
      if (size(samples) == 1) samples = spread(samples(1), 1, self%tones%n_tones)
      call new_torus(self%torus, samples, self%harmonics, error)
      if (allocated(error)) call group%problem("samples", error%message)

      effort = planning_names(1)
      call group%get("planning", effort, choices=planning_names)
      select case (effort)
      case ("measure"); self%planning = planning%measure
      case ("patient"); self%planning = planning%patient
      case default; self%planning = planning%estimate
      end select
      call group%get("wisdom", self%wisdom)
   end subroutine read_sampling

   !> Reads `&solver` into its configuration.
   subroutine read_solver(self, group)
      type(scene_t), intent(inout) :: self
      type(group_t), intent(inout) :: group
      character(:), allocatable :: first_guess, first_jacobian, name

      associate (solver => self%solver)
         name = trim(method_names(solver%method))
         first_jacobian = trim(start_names(merge(2, 1, solver%start_with_tangent)))
         first_guess = trim(first_guess_names(merge(1, 2, self%start_from_linear)))
         call group%get("method", name, choices=method_names)
         call group%get("tolerance", solver%tolerance, above=0.0_wp)
         call group%get("max_iterations", solver%max_iterations, minimum=0)
         call group%get("line_search", solver%line_search)
         call group%get("rescue", solver%rescue)
         call group%get("homotopy_iterations", solver%homotopy_iterations, minimum=0)
         call group%get("memory", solver%memory, minimum=1, maximum=10000)
         call group%get("first_jacobian", first_jacobian, choices=start_names)
         call group%get("first_guess", first_guess, choices=first_guess_names)
         solver%method = max(1, findloc(method_names == name, .true., dim=1))
         solver%start_with_tangent = first_jacobian == start_names(2)
         self%start_from_linear = first_guess == first_guess_names(1)
      end associate
   end subroutine read_solver

   !> Reads `&certificate`: whether it is made, and its thresholds.
   subroutine read_certificate(self, group)
      type(certificate_config_t), intent(inout) :: self
      type(group_t), intent(inout) :: group

      call group%get("is_on", self%is_on)
      call group%get("truncation", self%truncation, above=0.0_wp)
      call group%get("aliasing", self%aliasing, above=0.0_wp)
      call group%get("penetration", self%penetration, above=0.0_wp)
      call group%get("commensurability", self%commensurability, minimum=0.0_wp)
   end subroutine read_certificate

   !> Reads `&output`: title, stored degrees of freedom, grid of stored surfaces.
   subroutine read_output(self, group)
      type(scene_t), intent(inout) :: self
      type(group_t), intent(inout) :: group
      type(string_t), allocatable :: names(:)
      type(torus_t) :: torus
      type(error_t), allocatable :: error
      integer :: i

      associate (output => self%output)
         output%title = ""
         call group%get("title", output%title)
         call group%get("samples", output%samples, minimum=1)
         if (.not. allocated(output%samples)) allocate (output%samples(0))
         if (size(output%samples) == 1) output%samples = spread(output%samples(1), 1, self%tones%n_tones)
         if (size(output%samples) > 0 .and. size(output%samples) /= self%tones%n_tones) then
            call group%problem("samples", "give one number, or one for each of the "//to_text(self%tones%n_tones)//" tones")
         else if (size(output%samples) > 0) then
            call new_torus(torus, output%samples, self%harmonics, error)
            if (allocated(error)) call group%problem("samples", error%message)
         end if
         call group%get("dofs", names)
         if (allocated(names)) then
            allocate (output%dofs(size(names)))
            do i = 1, size(names)
               call self%structure%find_dof(names(i)%value, output%dofs(i), error)
               if (allocated(error)) call group%problem("dofs", error%message)
            end do
         else
            output%dofs = [(i, i=1, self%structure%n_dofs)]
         end if
      end associate
   end subroutine read_output
end module hb_scene
