!> Models from numbers: a structure, base frequencies, a set of harmonics and a grid of samples, to which laws and loads
!> are added. Settings have their defaults.
!>
!>     call new_model(model, beam_t(length=1.0_wp, ...), [omega], harmonics, [64], error)
!>     call add_law(model, rigid_wall_t(gap=1.0e-3_wp, augmentation=1.0e5_wp), ["v3"], error)
!>     call add_load(model, "v3", [1], 100.0_wp, 0.0_wp, error)
!>     call solve_motion(model, motion, error)
!>
!> An error is that of the last call; a model after an error must not be used.
module hb_new_model
   use hb_error, only: error_t, fail
   use hb_floquet, only: floquet_t
   use hb_harmonic_amplitude, only: harmonic_amplitude_t
   use hb_harmonics, only: harmonics_t, tuple_text
   use hb_kinds, only: wp
   use hb_law, only: law_box_t, law_t, new_law
   use hb_load, only: load_t
   use hb_model, only: model_t
   use hb_model_number, only: numbered_groups
   use hb_model_numbers, only: build_starts, update_loads
   use hb_structure_builder, only: structure_builder_t
   use hb_structure_load, only: load_box_t
   use hb_text, only: to_text
   use hb_tones, only: new_tones
   use hb_torus, only: new_torus
   implicit none
   private
   public :: add_law, add_load, new_model

contains

   !> Creates a model without laws and loads.
   subroutine new_model(self, builder, omega, harmonics, n_samples, error)
      type(model_t), intent(out) :: self
      class(structure_builder_t), intent(in) :: builder               !! of the structure
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      type(harmonics_t), intent(in) :: harmonics                      !! of as many tones
      integer, intent(in) :: n_samples(:)                             !! per period, (n_tones)
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      if (any([size(omega), size(n_samples)] /= harmonics%n_tones)) then
         call fail(error, "the set of harmonics has "//to_text(harmonics%n_tones)//" tones, there are "//to_text(size(omega))// &
                   " frequencies and "//to_text(size(n_samples))//" numbers of samples")
         return
      end if
      allocate (self%system%builder, source=builder)
      call self%system%builder%build(self%system%structure, error)
      if (.not. allocated(error)) call new_tones(self%system%tones, omega, error)
      if (.not. allocated(error)) call new_torus(self%discretisation%torus, n_samples, harmonics, error)
      if (allocated(error)) return
      self%discretisation%harmonics = harmonics
      allocate (self%system%elements(0), self%system%laws(0), self%system%law_groups(0), self%system%loads(0), &
                self%options%start%given(0), self%system%ties(0))
      allocate (self%options%gradient%names(0), self%options%gradient%by(0), self%options%output%samples(0))
      allocate (self%options%callbacks%stability_finder, source=floquet_t())
      self%options%output%title = ""
      self%options%output%dofs = [(i, i=1, self%system%structure%n_dofs)]
      self%options%integration%record = ""
      call update_loads(self%system, error)
      call build_starts(self)
   end subroutine new_model

   !> Adds a law at some degrees of freedom, as `new_law` does. Fails for an unknown one.
   subroutine add_law(self, law, dofs, error)
      type(model_t), intent(inout) :: self
      class(law_t), intent(in) :: law
      character(*), intent(in) :: dofs(:)                             !! labels, or numbers as texts
      type(error_t), allocatable, intent(out) :: error
      type(law_box_t) :: box
      integer :: i, places(size(dofs))

      do i = 1, size(dofs)
         call self%system%structure%find_dof(dofs(i), places(i), error)
         if (allocated(error)) return
      end do
      call new_law(box, law, "law "//to_text(size(self%system%laws) + 1), places, error)
      if (allocated(error)) return
      self%system%law_groups = [self%system%law_groups, size(self%system%laws) + 1]
      self%system%laws = [self%system%laws, box]
   end subroutine add_law

   !> Adds a force cos cos(j.tau) + sin sin(j.tau). Fails for an unknown degree of freedom, and for a tuple that the set of
   !> harmonics does not have.
   subroutine add_load(self, dof, tuple, cosine, sine, error)
      type(model_t), intent(inout) :: self
      character(*), intent(in) :: dof                                 !! label, or number as text
      integer, intent(in) :: tuple(:)                                 !! j, (n_tones)
      real(wp), intent(in) :: cosine, sine                            !! [N]
      type(error_t), allocatable, intent(out) :: error
      type(load_box_t), allocatable :: boxes(:)
      type(load_t) :: load
      integer :: i, place

      call self%system%structure%find_dof(dof, place, error)
      if (allocated(error)) return
      if (size(tuple) /= self%discretisation%harmonics%n_tones) then
         call fail(error, "a tuple needs "//to_text(self%discretisation%harmonics%n_tones)//" entries, one per tone")
      else if (self%discretisation%harmonics%index_of(tuple) == 0) then
         call fail(error, "tuple "//tuple_text(tuple)//" is not in the set of harmonics")
      end if
      if (allocated(error)) return
      load%tuple = tuple
      load%dofs = [place]
      load%weights = [1.0_wp]
      load%amplitude = harmonic_amplitude_t(cosine, sine)
      associate (n => size(self%system%loads))
         allocate (boxes(n + 1))
         do i = 1, n
            boxes(i)%object = self%system%loads(i)%object
            boxes(i)%i = self%system%loads(i)%i
            call move_alloc(self%system%loads(i)%load, boxes(i)%load)
         end do
         boxes(n + 1)%object = findloc(numbered_groups%name == "load", .true., dim=1)
         boxes(n + 1)%i = count(boxes(:n)%object == boxes(n + 1)%object) + 1
         allocate (boxes(n + 1)%load, source=load)
      end associate
      call move_alloc(boxes, self%system%loads)
      call update_loads(self%system, error)
   end subroutine add_load
end module hb_new_model
